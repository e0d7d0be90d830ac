# SPDX-License-Identifier: Apache-2.0
"""One file per effect of the vocabulary (DESIGN.md section 3)."""
