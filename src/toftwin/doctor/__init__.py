# SPDX-License-Identifier: Apache-2.0
"""What `toftwin doctor` looks at, one file an idea; every finding says what to do."""
