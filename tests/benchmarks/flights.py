"""What the scripts beside it share: commands that are run, and what is flown and evaluated with them."""
import csv
import json
import os
import subprocess
import sys


def run(command, log):
    """Its output goes to the file `log`; ends the script where it fails."""
    with open(log, "w", encoding="utf-8") as out:
        if subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, check=False).returncode != 0:
            sys.exit(f"error: {' '.join(command)}: failed, see {log}")


def program(path):
    if not os.access(path, os.X_OK):
        sys.exit(f"error: {path} is not there: build it, or name another")
    return path


def map_images(tool, mission, out, nav, extra=()):
    """Maps a rendered mission with the navigation of the table `nav`, unless that has been done."""
    if not os.path.isdir(out):
        run([tool, "map", mission, "--nav", nav, "--out", out, *extra], out + ".log")
    return out


def read_table(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_table(rows, path):
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def without_log(source, out):
    """The navigation table `source` as it is where no Doppler log measures speed."""
    rows = read_table(source)
    for row in rows:
        for name in row:
            if name.endswith("_mps"):
                row[name] = ""
    write_table(rows, out)
    return out


def evaluate(tool, flown, truth):
    """Of the poses as published, aligned in position and yaw alone."""
    return json.loads(subprocess.run([tool, "evaluate", flown, truth, "--align", "yaw", "--json"],
                                     capture_output=True, text=True, check=True).stdout)
