# SPDX-License-Identifier: Apache-2.0
"""Captures, views, cameras, poses, units, errors, configuration, and bags in and out."""
