# SPDX-License-Identifier: Apache-2.0
"""Depth, poses and runs of the graph against a reference: methods that repair depth, their scores, and the report of both."""
