# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a virtual session from recording to labels, and what follows from them."""
