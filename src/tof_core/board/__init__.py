# SPDX-License-Identifier: Apache-2.0
"""Calibration boards seen in the amplitude image: corners, and the camera's pose from them."""
