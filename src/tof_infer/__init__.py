# SPDX-License-Identifier: Apache-2.0
"""The depth-repair network: training, export and ONNX inference."""
