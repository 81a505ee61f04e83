"""Threads of torch in every test, whatever the machine has and whatever another test has set."""

import os

THREADS = int(os.environ.get("OMP_NUM_THREADS", "1"))
