# SPDX-License-Identifier: Apache-2.0
"""Labels rendered at a solved pose, and the dataset that stores them."""
