# SPDX-License-Identifier: Apache-2.0
"""Multipath against a path tracer of other people (mitransient): how much of the traced error the effect leaves."""
