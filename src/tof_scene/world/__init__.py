# SPDX-License-Identifier: Apache-2.0
"""Differences between the cell and its CAD: absent parts, foreign objects and displaced parts, from measured and rendered depth."""
