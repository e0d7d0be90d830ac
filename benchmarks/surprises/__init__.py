# SPDX-License-Identifier: Apache-2.0
"""Sessions of the emerging camera in a world that is not its CAD: objects that it lacks, missing and displaced parts, a person's arm."""
