"""The pages of the documentation as blocks to run: files, Python, commands and what they print.

A line of the source that begins with ``%`` is a comment, which no reader sees. Right before a block it says
what to do with it:

* ``% load: package.function: ARGUMENTS``: the file that the block shows is what this function reads;
* ``% run with: WORDS: ARGUMENTS``: commands that begin with these words get these arguments as well, last, so
  that they run on less;
* ``% exit: N``: the exit code;
* ``% output``, ``% output: within P %``: the block, or what follows the commands in it, is what they print,
  up to spaces and rules, with numbers as close as this or a unit of their last digit; a line ``...`` stands
  for any other lines;
* ``% output not compared: REASON``;
* ``% skip: WORDS: REASON``: commands that begin with these words are not run;
* ``% not run: REASON``: nor is the block.
"""

import contextlib
import importlib
import io
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from socwise.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^(`{3,})(?:\{([\w-]+)\} ?)?([^\n`]*)\n(.*?)^\1$", re.MULTILINE | re.DOTALL)
MARKS = ("load", "run with", "exit", "output", "output not compared", "skip", "not run")
NOT_CODE = ("toctree", "eval-rst", "figure", "image", "note", "literalinclude", "raw")
NUMBER = re.compile(r"[-+−]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
COLUMNS = "100"


@dataclass(frozen=True)
class Block:
    """One block of code: where it stands, what it is, and the marks before it."""

    page: str
    line: int
    language: str
    caption: str
    text: str
    marks: dict[str, list[str]] = field(hash=False)

    @property
    def place(self):
        return f"{self.page}:{self.line}"

    @property
    def is_file(self):
        return re.fullmatch(r"[\w-]+(\.\w+)+", self.caption) is not None

    @property
    def first(self):
        return self.text.splitlines()[0]

    def mark(self, name):
        return self.marks.get(name, [None])[-1]


def page_names():
    """Names of all pages, the read-me first."""
    below = sorted(path.relative_to(DOCS) for path in DOCS.rglob("*.md") if "_build" not in path.parts)
    return ["README", *(path.with_suffix("").as_posix() for path in below)]


def source(page):
    """The text of a page."""
    return (ROOT / "README.md" if page == "README" else DOCS / f"{page}.md").read_text(encoding="utf-8")


def blocks(page):
    """The blocks of a page, in order."""
    text = source(page)
    found = []
    for match in FENCE.finditer(text):
        directive, argument, body = match[2], match[3].strip(), match[4]
        if directive in NOT_CODE:
            continue
        assert directive in (None, "code-block"), f"{page}: what is {{{directive}}}?"
        options, body = _options(body)
        found.append(
            Block(
                page,
                text[: match.start()].count("\n") + 1,
                argument,
                options.get("caption", ""),
                body,
                _marks(text[: match.start()]),
            )
        )
    return found


def _options(body):
    options = {}
    while match := re.match(r":(\w+): ?(.*)\n", body):
        options[match[1]] = match[2]
        body = body[match.end() :]
    return options, body


def _marks(before):
    marks = {}
    for line in reversed(before.splitlines()):
        if not line.startswith("% "):
            break
        name, _, value = line[2:].partition(": ")
        assert name in MARKS, f"no mark is called {name!r}"
        marks.setdefault(name, []).insert(0, value)
    return marks


def commands(block):
    """The commands of a console block, each with the lines that it prints."""
    found = []
    for line in block.text.splitlines():
        if found and found[-1][0].endswith("\\"):
            found[-1][0] = found[-1][0][:-1] + line.strip()
        elif line.startswith("$ "):
            found.append([line[2:], []])
        else:
            found[-1][1].append(line)
    return [(command, "\n".join(lines)) for command, lines in found]


def skipped(block, command):
    """Why a command is not run; None if it is."""
    for mark in block.marks.get("skip", ()):
        words, _, reason = mark.partition(": ")
        if command.startswith(words):
            return reason
    return None


def not_run(block):
    """What of a block is not run: pairs of first line or command, and reason."""
    if block.mark("not run"):
        return [(block.first.removeprefix("$ "), block.mark("not run"))]
    if block.language != "console":
        return []
    pairs = [(command, skipped(block, command)) for command, _ in commands(block)]
    return [(command, reason) for command, reason in pairs if reason]


class Page:
    """Runs a page in the current folder."""

    def __init__(self, name, makers=None):
        self.blocks = blocks(name)
        self.makers = makers or {}
        self.namespace = {"__name__": "__main__"}
        self.printed = ""

    def run(self):
        """Write its files, run its code in order, hold what it prints against what it shows."""
        self.write_files()
        for block in self.blocks:
            if block.mark("not run"):
                continue
            if block.mark("load"):
                load(block)
            if block.is_file:
                continue
            if block.language == "python":
                self.run_python(block)
            elif block.language == "console":
                self.run_commands(block)
            else:
                assert "output" in block.marks, f"{block.place} is neither a file, nor run, nor output"
                compare(self.printed, block.text, block)

    def write_files(self):
        """Write what the page shows as files, and what its commands take besides."""
        shown = [block for block in self.blocks if block.is_file]
        for block in shown:
            assert not Path(block.caption).exists(), f"{block.place}: {block.caption} is there already"
            Path(block.caption).write_text(block.text, encoding="utf-8")
        text = "\n".join(block.text for block in self.blocks if not block.is_file)
        for name, make in self.makers.items():
            if re.search(rf"(?<![\w/]){re.escape(name)}\b", text) and not Path(name).exists():
                Path(name).parent.mkdir(parents=True, exist_ok=True)
                make(Path(name))

    def run_python(self, block):
        code = compile("\n" * block.line + block.text, f"{block.page}.md", "exec")
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(code, self.namespace)
        self.printed = out.getvalue()

    def run_commands(self, block):
        for command, shown in commands(block):
            if skipped(block, command):
                continue
            code, printed = run_command(block, command)
            assert code == int(block.mark("exit") or 0), f"{block.place}: {command}\n{printed}"
            if shown.strip() and "output not compared" not in block.marks:
                compare(printed, shown, block)
            self.printed = printed


def run_command(block, command):
    """Run one command; exit code, and what it prints: both streams, in the order answer, messages."""
    command, _, target = command.partition(" > ")
    words = shlex.split(command)
    if words[0] == "socwise":
        for mark in block.marks.get("run with", ()):
            prefix, _, arguments = mark.partition(": ")
            if command.startswith(f"socwise {prefix}"):
                words += shlex.split(arguments)
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(words[1:])
        answer, messages = out.getvalue(), err.getvalue()
    else:
        program = sys.executable if words[0] == "python" else shutil.which(words[0])
        assert program, f"{block.place}: {words[0]} is not there"
        done = subprocess.run([program, *words[1:]], capture_output=True, text=True, check=False)
        code, answer, messages = done.returncode, done.stdout, done.stderr
    if target:
        Path(target).write_text(answer, encoding="utf-8")
    return code, answer + messages


def load(block):
    """Read the file that a block shows with the function that it names."""
    function, _, arguments = block.mark("load").partition(": ")
    module, _, name = function.rpartition(".")
    getattr(importlib.import_module(module), name)(block.caption, *arguments.split())


def compare(printed, shown, block):
    """Hold what was printed against what the page shows."""
    percent = re.search(r"within ([\d.]+) %", block.mark("output") or "")
    share = float(percent[1]) / 100 if percent else 0.0
    got, at = words_of(printed), 0
    for number, part in enumerate(re.split(r"^\s*\.\.\.$", shown, flags=re.MULTILINE)):
        wanted = words_of(part)
        starts = range(at, len(got) + 1) if number else (at,)
        where = next((start for start in starts if begins(got[start:], wanted, share)), None)
        assert where is not None, f"{block.place} shows\n{part}\nand what is printed is\n{printed}"
        at = where + len(wanted)
    assert at == len(got) or re.search(r"^\s*\.\.\.\s*\Z", shown, re.MULTILINE), (
        f"{block.place} does not show {' '.join(got[at:])!r}"
    )


def words_of(text):
    return re.sub(r"[─━╌│┃]+", " ", text).split()


def begins(got, wanted, share):
    return len(got) >= len(wanted) and all(map(same, got, wanted, [share] * len(wanted)))


def same(got, wanted, share):
    """Whether two words are equal but for the size of the numbers in them."""
    if got == wanted:
        return True
    ours, theirs = NUMBER.findall(got), NUMBER.findall(wanted)
    if NUMBER.sub("#", got) != NUMBER.sub("#", wanted) or not ours:
        return False
    return all(close(a, b, share) for a, b in zip(ours, theirs, strict=True))


def close(got, wanted, share):
    values = [float(text.replace(",", "").replace("−", "-")) for text in (got, wanted)]
    mantissa, _, exponent = wanted.partition("e")
    digits = len(mantissa.partition(".")[2])
    unit = 10.0 ** (int(exponent or 0) - digits)
    return abs(values[0] - values[1]) <= max(share * abs(values[1]), 1.001 * unit if share else 0.0)
