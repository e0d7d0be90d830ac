# SPDX-License-Identifier: Apache-2.0
"""The forward sensor model: effects that can be added to a rendered view."""
