# SPDX-License-Identifier: Apache-2.0
"""The command line, the offline pipelines and the node graph."""
