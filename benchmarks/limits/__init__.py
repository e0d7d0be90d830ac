# SPDX-License-Identifier: Apache-2.0
"""Every number that decides, halved and doubled: which verdicts and which figures change."""
