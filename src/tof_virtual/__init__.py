# SPDX-License-Identifier: Apache-2.0
"""A virtual robot whose AMCW camera is simulated tap by tap and recorded to bags."""
