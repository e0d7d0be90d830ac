# SPDX-License-Identifier: Apache-2.0
"""The diagnosis checked on sessions whose effect is withheld: draw and seal, diagnose, open and score."""
