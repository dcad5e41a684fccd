"""Read a study from a TOML file; everything that is wrong with it is reported at once."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from socwise.study.checks import between
from socwise.study.errors import StudyError
from socwise.study.problems import Problem, explain
from socwise.study.schema import Study


@dataclass(frozen=True)
class LoadedStudy:
    """A study, where it comes from, and its text.

    Parameters
    ----------
    study : Study
        What it says.
    folder : Path
        Where relative paths in it start from.
    text : str
        The file as it was.
    """

    study: Study
    folder: Path
    text: str


def load_study(path: Path | str) -> LoadedStudy:
    """Read a study file.

    Parameters
    ----------
    path : Path or str
        A TOML file; paths in it are relative to its folder.

    Raises
    ------
    StudyError
        If it cannot be read or is not a study: every problem with its path, what was given and what is
        allowed.
    """
    place = Path(path)
    try:
        text = place.read_bytes().decode("utf-8")
        data = tomllib.loads(text.replace("\r\n", "\n"))
    except OSError as error:
        raise StudyError(f"cannot read the study {place}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise StudyError(f"{place} is not UTF-8 text; save it with UTF-8 encoding") from error
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{place} is not valid TOML: {error}") from error
    return LoadedStudy(parse_study(data, place.parent, str(place)), place.parent.absolute(), text)


def parse_study(data: dict[str, Any], folder: Path, origin: str = "the study") -> Study:
    """Check the content of a study file.

    Parameters
    ----------
    data : dict
        What the file says.
    folder : Path
        Where relative paths start from.
    origin : str
        What to call it in errors.

    Raises
    ------
    StudyError
        With all that is wrong.
    """
    problems: list[Problem] = []
    study = None
    try:
        study = Study.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        problems += explain(error)
    known = {problem.path for problem in problems}
    problems += [problem for problem in between(data) if problem.path not in known]
    if problems or study is None:
        count = f"{len(problems)} things are" if len(problems) != 1 else "one thing is"
        raise StudyError(f"{origin} cannot be run, {count} wrong:", [str(problem) for problem in problems])
    return study
