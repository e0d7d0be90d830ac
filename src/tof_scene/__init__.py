# SPDX-License-Identifier: Apache-2.0
"""The CAD scene: parts, materials, ray casting and pixel footprints."""
