# SPDX-License-Identifier: Apache-2.0
"""The depth correction network: training, export and ONNX inference."""
