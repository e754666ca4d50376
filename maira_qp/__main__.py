"""`python -m maira_qp`: the command line."""

import sys

from maira_qp.apps.cli import main

sys.exit(main())
