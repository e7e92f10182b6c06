"""The plugins beside the tests are used by name, as `toys:Class`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
