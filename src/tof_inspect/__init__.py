# SPDX-License-Identifier: Apache-2.0
"""Part presence judged from 2D and 3D evidence against the CAD."""
