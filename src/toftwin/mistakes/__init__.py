# SPDX-License-Identifier: Apache-2.0
"""The usual mistakes in what a bag and a scene state, found by rendering a few views against the CAD."""
