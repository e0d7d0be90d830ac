# SPDX-License-Identifier: Apache-2.0
"""Where simulation and camera differ, which effect makes it, and how far it shrinks."""
