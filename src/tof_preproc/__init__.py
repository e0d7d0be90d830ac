# SPDX-License-Identifier: Apache-2.0
"""Accumulation and filters; every removed pixel keeps its reason."""
