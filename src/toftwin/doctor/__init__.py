# SPDX-License-Identifier: Apache-2.0
"""The checks of `toftwin doctor`, one file a subject; each finding says what to do."""
