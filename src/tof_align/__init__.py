# SPDX-License-Identifier: Apache-2.0
"""One view, a station or a session aligned to the CAD, with verdict and covariance."""
