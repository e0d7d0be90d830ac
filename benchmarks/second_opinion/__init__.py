# SPDX-License-Identifier: Apache-2.0
"""A second judge of the diagnosis' own evidence: spike and slab over the same normal equations, sampled by numpyro."""
