# SPDX-License-Identifier: Apache-2.0
"""How well methods that repair depth do against the true depth: the paper's figure 9, and where each of them fails."""
