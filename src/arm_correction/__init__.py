# SPDX-License-Identifier: Apache-2.0
"""The corrective hand pose that makes the next view the reference view again, or a refusal."""
