# SPDX-License-Identifier: Apache-2.0
"""Every number that decides in the diagnosis: name, default, unit, bounds, meaning and reason, a file for each subject."""
