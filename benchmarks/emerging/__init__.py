# SPDX-License-Identifier: Apache-2.0
"""A camera whose depth errors emerge from physical causes: waveforms in time, charge, clocks, heat, light paths, firmware."""
