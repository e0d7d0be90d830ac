# SPDX-License-Identifier: Apache-2.0
"""Planes in a depth image, and their use as evidence: does it hold z, or the distance along the ray?"""
