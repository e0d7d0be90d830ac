# SPDX-License-Identifier: Apache-2.0
"""From a solution to the report: causes, figures, places, words."""
