# SPDX-License-Identifier: Apache-2.0
"""One file per effect of docs/effects.md; the registry finds all of them."""
