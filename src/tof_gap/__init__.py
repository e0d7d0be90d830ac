# SPDX-License-Identifier: Apache-2.0
"""The gap between simulation and camera: where it is, which effects cause it, and how far it shrinks."""
