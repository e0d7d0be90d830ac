# SPDX-License-Identifier: Apache-2.0
"""What a session shows: residuals, noise, lost returns, patterns."""
