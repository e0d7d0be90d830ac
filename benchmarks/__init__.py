# SPDX-License-Identifier: Apache-2.0
"""Figures with the commands that print them: `python -m benchmarks --help`."""
