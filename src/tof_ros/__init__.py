# SPDX-License-Identifier: Apache-2.0
"""What the nodes share: messages, transforms, parameters, QoS, diagnostics. Imports tof_core alone."""
