# SPDX-License-Identifier: Apache-2.0
"""The gap check on a foreign camera: sessions of the emerging camera, drawn, sealed and scored without any help of the diagnosis."""
