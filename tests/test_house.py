"""The house rules of DESIGN.md, held against the source: who imports whom, kernels, docstrings, types."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

MAY_IMPORT = {
    "gpc": set(),
    "drivecycles": {"gpc"},
    "vehicle": {"gpc", "drivecycles"},
    "bms": {"gpc"},
    "ems": {"gpc", "drivecycles", "vehicle", "bms"},
    "socwise": {"gpc", "drivecycles", "vehicle", "bms", "ems"},
}

HEAVY = {"casadi", "fmpy", "matplotlib", "plotly"}

COMPILERS = {"njit", "jit", "vectorize", "guvectorize", "stencil", "cfunc"}


def sources(package):
    return sorted((ROOT / package).rglob("*.py"))


EVERY_SOURCE = [path for package in MAY_IMPORT for path in sources(package)]
KERNELS = [path for path in EVERY_SOURCE if path.stem.startswith("_") and path.stem != "__init__"]
PUBLIC = [path for path in EVERY_SOURCE if path not in KERNELS]


def each(paths):
    return pytest.mark.parametrize("path", paths, ids=lambda path: path.relative_to(ROOT).as_posix())


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def roots(nodes):
    """Top-level names that import statements name; a relative import counts as '.'."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("." if node.level else node.module.split(".")[0])
    return found


def run_at_import(body):
    """Statements that importing a module executes: not those in functions or under TYPE_CHECKING."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            yield from run_at_import(node.orelse)
            continue
        yield node
        yield from run_at_import(ast.iter_child_nodes(node))


def called(node):
    """Name of a decorator or of a called function, without its module."""
    target = node.func if isinstance(node, ast.Call) else node
    return target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", "")


def decorators_and_calls(tree):
    """Every place where a compiler of numba can be asked to work."""
    found = {node for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found |= set(node.decorator_list)
    return found


def uncached(tree):
    """Lines where numba is asked to compile without keeping the result."""
    for node in decorators_and_calls(tree):
        if called(node) in COMPILERS:
            options = (
                {k.arg: ast.unparse(k.value) for k in node.keywords} if isinstance(node, ast.Call) else {}
            )
            if options.get("cache") != "True":
                yield node.lineno


def undocumented(tree):
    """Public classes, functions and methods without a docstring, by name."""
    if not ast.get_docstring(tree):
        yield "the module"
    waiting = [("", node) for node in tree.body]
    while waiting:
        owner, node = waiting.pop()
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        if node.name.startswith("_"):
            continue
        if not ast.get_docstring(node):
            yield f"{owner}{node.name}"
        if isinstance(node, ast.ClassDef):
            waiting += [(f"{node.name}.", child) for child in node.body]


@each(EVERY_SOURCE)
def test_imports_go_one_way(path):
    package = path.relative_to(ROOT).parts[0]
    imported = roots(ast.walk(tree_of(path)))
    forbidden = set(MAY_IMPORT) - MAY_IMPORT[package] - {package}
    assert imported & forbidden == set()
    assert imported & {".", "tests", "benchmarks", "tools"} == set()


@each([path for path in EVERY_SOURCE if path.relative_to(ROOT).parts[0] != "socwise"])
def test_pictures_and_plants_are_imported_only_where_they_are_used(path):
    assert roots(run_at_import(tree_of(path).body)) & HEAVY == set()


@each(KERNELS)
def test_kernels_know_numbers_only(path):
    tree = tree_of(path)
    assert roots(ast.walk(tree)) & ({"pydantic", "typer", "rich", "pathlib"} | HEAVY) == set()
    models = {
        alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert models & {"BaseModel", "Path"} == set()


@each(EVERY_SOURCE)
def test_compiled_functions_are_cached_and_keep_nan(path):
    tree = tree_of(path)
    assert list(uncached(tree)) == []
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert "jitclass" not in names
    fast = [k for k in ast.walk(tree) if isinstance(k, ast.keyword) and k.arg == "fastmath"]
    assert [k.value.lineno for k in fast if ast.unparse(k.value) != "False"] == []


def test_compiled_functions_live_in_kernels():
    """And there are some: otherwise the rule above would hold of nothing."""
    compiled = [
        path
        for path in EVERY_SOURCE
        if any(called(node) in COMPILERS for node in decorators_and_calls(tree_of(path)))
    ]
    assert compiled != []
    assert [path for path in compiled if path not in KERNELS] == []


@each(PUBLIC)
def test_what_is_public_says_what_it_is(path):
    assert list(undocumented(tree_of(path))) == []


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_packages_are_typed_and_shipped(package):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert (ROOT / package / "__init__.py").is_file()
    assert (ROOT / package / "py.typed").is_file()
    assert package in project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert package in project["tool"]["mypy"]["packages"]


@pytest.mark.parametrize("package", ["gpc", "drivecycles", "vehicle", "bms", "ems"])
def test_importing_a_package_is_cheap(package):
    unwanted = HEAVY | ({"joblib", "pandas", "rich", "numba"} if package != "ems" else set())
    code = f"import sys, {package}; print(sorted(set({sorted(unwanted)}) & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_rules_catch_what_they_are_meant_to():
    """Each finder on a few lines that break its rule."""
    tree = ast.parse(
        "@njit\ndef f(): ...\n@numba.njit(cache=False)\ndef g(): ...\n@njit(cache=True)\ndef h(): ..."
    )
    assert sorted(uncached(tree)) == [1, 3]
    assert list(uncached(ast.parse("f = nb.jit(f, nopython=True)"))) == [1]
    lazy = ast.parse(
        "if TYPE_CHECKING:\n import a\nelse:\n import b\ndef f():\n import c\ntry:\n import d\nfinally: 0"
    )
    assert roots(run_at_import(lazy.body)) == {"b", "d"}
    assert roots(ast.walk(ast.parse("from . import x\nfrom ems.loop import y\nimport bms.pack"))) == {
        ".",
        "ems",
        "bms",
    }
    tree = ast.parse('"""M."""\ndef f(): ...\ndef _g(): ...\nclass C:\n "C."\n def m(self): ...')
    assert sorted(undocumented(tree)) == ["C.m", "f"]
