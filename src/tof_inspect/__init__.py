# SPDX-License-Identifier: Apache-2.0
"""Presence of parts from 2D and 3D evidence against the CAD."""
