# SPDX-License-Identifier: Apache-2.0
"""Pairs of sessions of the emerging camera, a real one and a simulator's, whose difference the generator knows."""
