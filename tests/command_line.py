"""Run the command line in this process, and what it is given to work with."""

import math
from pathlib import Path

import ems.concept
from socwise.cli import main

SECONDS = 60


class Outcome:
    """Exit code and both streams of one command."""

    def __init__(self, code, out, err):
        self.code, self.out, self.err = code, out, err


def run(capsys, *arguments):
    """Run a command, with everything that was written before it forgotten."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    return Outcome(code, *capsys.readouterr())


def write_cycle(path, seconds=SECONDS):
    """Write a trip of one hill of speed, up to 60 km/h, with a gentle rise on the way."""
    rows = ["time_s,speed_kmh,altitude_m"]
    for second in range(seconds + 1):
        phase = math.pi * second / seconds
        rows.append(f"{second},{max(60.0 * math.sin(phase), 0.0):.6f},{2.0 * math.sin(phase) ** 2:.6f}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def preset_text(name="hev"):
    """Return the text of a concept that comes with socwise."""
    return (Path(ems.concept.PRESETS) / f"{name}.toml").read_text(encoding="utf-8")


def tree(folder):
    """Return what is below a folder: path, and content of files."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }
