"""What is not physics: public names, the stub of the compiled core, the README's example, data files."""

import ast
import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import bullet_tendon as bt
from bullet_tendon import _core

ROOT = Path(__file__).parents[2]
STUB = ROOT / "bullet_tendon" / "_core.pyi"
README = (ROOT / "README.md").read_text(encoding="utf-8")
READMES = [
    "README.md",
    "bullet_tendon/README.md",
    "bullet_tendon/core/README.md",
    "scenarios/README.md",
    "scenarios/benchmarks/README.md",
    "scenarios/manual/README.md",
    "tests/README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "urdf/README.md",
]


def stub_methods() -> dict[str, ast.FunctionDef]:
    """The public methods of World in the stub."""
    tree = ast.parse(STUB.read_text(encoding="utf-8"))
    world = next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == "World")
    return {
        node.name: node for node in world.body if isinstance(node, ast.FunctionDef) and node.name[0] != "_"
    }


def core_methods() -> dict:
    return {name: getattr(_core.World, name) for name in dir(_core.World) if name[0] != "_"}


def public_functions():
    """Classes, functions and methods behind the public names, as (name, object)."""
    for name in bt.__all__:
        thing = getattr(bt, name)
        yield name, thing
        if inspect.isclass(thing):
            for key, member in vars(thing).items():
                member = getattr(member, "__func__", member)
                if key[0] != "_" and inspect.isfunction(member):
                    yield f"{name}.{key}", member


def run_python(*arguments) -> str:
    """Standard output of a Python process that finds what this one finds; its failure is an assertion."""
    paths = os.pathsep.join(os.path.abspath(path) for path in sys.path)
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_stub_names_the_methods_of_the_core():
    assert set(stub_methods()) == set(core_methods())


def test_stub_and_core_agree_on_the_number_of_arguments():
    """pybind11 writes a signature with arg0, arg1 ... into the first line of each docstring."""
    in_core = {name: len(re.findall(r"\barg\d+:", method.__doc__)) for name, method in core_methods().items()}
    stub = {name: node.args for name, node in stub_methods().items()}
    in_stub = {name: len(args.posonlyargs) + len(args.args) - 1 for name, args in stub.items()}  # less self
    assert in_stub == in_core


def test_public_names_exist():
    assert sorted(bt.__all__) == list(bt.__all__)
    assert [name for name in bt.__all__ if not hasattr(bt, name)] == []


def test_public_classes_functions_and_methods_are_documented():
    bare = [name for name, thing in public_functions() if not (thing.__doc__ or "").strip()]
    assert bare == []


def test_modules_are_documented():
    names = [f"bullet_tendon.{entry.name}" for entry in pkgutil.iter_modules(bt.__path__)]
    assert "bullet_tendon.world" in names
    assert [name for name in names if not (importlib.import_module(name).__doc__ or "").strip()] == []


def test_version_is_the_one_that_is_built():
    """In a checkout that of setup.py; installed, that of the package's metadata as well."""
    told = re.search(r'version="([^"]+)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    assert bt.__version__ == told.group(1)
    try:
        installed = metadata.version("bullet_tendon")
    except metadata.PackageNotFoundError:
        return
    assert bt.__version__ == installed


@pytest.mark.parametrize("name", ["knee.urdf", "femur.urdf", "tibia.urdf", "meshes/femur.obj"])
def test_data_files_are_found(name):
    path = bt.data_path(name)
    assert os.path.isabs(path) and os.path.getsize(path) > 0


def test_data_path_names_what_there_is():
    with pytest.raises(bt.InvalidValue, match="knee.urdf") as problem:
        bt.data_path("hip.urdf")
    assert problem.value.argument == "name" and problem.value.value == "hip.urdf"


@pytest.mark.parametrize(
    ("name", "error"), [("", bt.InvalidValue), (3, bt.InvalidType), (None, bt.InvalidType)]
)
def test_data_path_refuses_what_is_no_name(name, error):
    with pytest.raises(error):
        bt.data_path(name)


@pytest.mark.parametrize(
    "kind", [bt.InvalidValue, bt.InvalidType, bt.UnknownId, bt.UrdfError, bt.MissingExtra]
)
def test_errors_share_one_base(kind):
    assert issubclass(kind, bt.TendonError)


def test_readme_example_prints_what_it_says():
    code = re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1)
    said = re.search(r"# prints (.*)", code).group(1)
    assert run_python("-c", code).splitlines()[-1] == said.strip()


@pytest.mark.parametrize("package", ["scenarios", "scenarios.benchmarks"])
def test_readmes_name_every_scenario_and_benchmark(package):
    known = run_python("-m", f"bullet_tendon.{package}").splitlines()
    rows = (ROOT / package.replace(".", "/") / "README.md").read_text(encoding="utf-8").splitlines()
    named = {line.split("`")[1] for line in rows if line.startswith(("| `", "| [`"))}
    names = {line.split()[0] for line in known if line and not line.startswith("pybullet ")}
    assert len(names) > 5
    assert names <= named


def test_the_first_readme_shows_a_picture():
    links = re.findall(r"!\[[^]]*\]\(([^)#:]+)\)", README)
    assert any(link.endswith(".png") for link in links)


def headings(path: Path) -> set[str]:
    """The anchors that a Markdown file has, as GitHub makes them of its headings."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", READMES, ids=str)
def test_readmes_refer_to_files_and_headings_that_are_there(page):
    missing = []
    for link in re.findall(r"\]\(([^)]+)\)", (ROOT / page).read_text(encoding="utf-8")):
        file, _, heading = link.partition("#")
        target = (ROOT / page).parent / file if file else ROOT / page
        if ":" not in link and not (target.exists() and (not heading or heading in headings(target))):
            missing.append(link)
    assert missing == []


def description() -> str:
    """The long description that setup.py makes, without running the rest of it."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    (function,) = (node for node in tree.body if getattr(node, "name", "") == "long_description")
    names = {"re": re, "Path": lambda name: ROOT / name}
    exec(compile(ast.Module([function], []), "setup.py", "exec"), names)
    return names["long_description"]()


def test_the_long_description_has_no_links_to_files():
    """An index shows it without the checkout."""
    text = description()
    assert "](http" in text and "```python" in text
    assert not re.findall(r"\]\((?!https?:)[^)]*\)", text)
    assert "![" not in text


def test_the_citation_is_of_this_version():
    text = (ROOT / ".github" / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", text, re.MULTILINE).group(1) == bt.__version__
    assert f"## {bt.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
