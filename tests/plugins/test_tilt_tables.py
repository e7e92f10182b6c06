"""The study that prints Tables 1 and 2 of Liu et al. 2018."""

import json
import subprocess
import sys
from pathlib import Path

STUDY = Path(__file__).parents[2] / "graphs" / "studies" / "tilt_tables.yaml"


def test_each_entry_is_as_printed(tmp_path):
    command = [sys.executable, "-m", "lodeflow.cli", "study", str(STUDY), "--jobs", "1", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    tables = json.loads(done.stdout)["tables"]
    compared = 0
    for table in tables if isinstance(tables, list) else tables.values():
        for row in table["rows"]:
            for name, printed in row["reference"].items():
                assert round(row["values"][name], 2) == printed, (row, name)
                compared += 1
    assert compared == 5 * (3 + 2 + 1)
