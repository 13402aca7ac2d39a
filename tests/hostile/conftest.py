"""The judge forks, and looks into /proc: Linux alone."""

import sys

collect_ignore_glob = [] if sys.platform.startswith("linux") else ["*"]
