# SPDX-License-Identifier: Apache-2.0
"""`python -m toftwin`: the same as `toftwin`."""

import sys

from toftwin.cli import main

sys.exit(main())
