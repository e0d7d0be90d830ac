# SPDX-License-Identifier: Apache-2.0
"""What a solution says: causes, figures, places, report."""
