# SPDX-License-Identifier: Apache-2.0
"""A world that is not the CAD: absent parts, foreign objects and displaced parts, from measured depth against the rendering."""
