# SPDX-License-Identifier: Apache-2.0
"""Helpers for ROS 2 nodes: messages, TF, parameters, QoS and diagnostics."""
