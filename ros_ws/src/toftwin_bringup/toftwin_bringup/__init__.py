# SPDX-License-Identifier: Apache-2.0
"""Nothing but data is in this package; the nodes are in `toftwin`."""
