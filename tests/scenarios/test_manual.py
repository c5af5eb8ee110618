"""The manual: its code runs, its recipes are all listed, and every public name is in its reference."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from bullet_tendon.scenarios import runner
from bullet_tendon.scenarios.manual import completeness
from bullet_tendon.scenarios.manual.__main__ import build, copy_sources, main
from bullet_tendon.scenarios.scene import Options

import bullet_tendon as bt

ROOT = Path(__file__).parents[2]
MANUAL = ROOT / "scenarios" / "manual"
READMES = sorted(path for path in ROOT.rglob("README.md") if not set(path.parts) & {"build", ".venv-run"})
PAGES = sorted(MANUAL.glob("*.md"))
BLOCK = re.compile(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", re.DOTALL)
MARK = "=== end of a block ==="


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(path: Path) -> list[tuple[str, str]]:
    """Code of each Python block, and what it is said to print, or ""."""
    return BLOCK.findall(path.read_text(encoding="utf-8"))


def run_program(code: str, folder: Path) -> str:
    """Standard output of a program in a file."""
    file = folder / "program.py"
    file.write_text(code, encoding="utf-8")
    return run_python(str(file), cwd=folder)


def run_python(*arguments, **others) -> str:
    """Standard output of a Python process that finds what this one finds."""
    paths = os.pathsep.join(os.path.abspath(path) for path in sys.path)
    command, environment = [sys.executable, *arguments], {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, **others)
    assert done.returncode == 0, done.stderr
    return done.stdout


SINGLE = [
    (relative(path), code)
    for path in READMES
    for code, _ in blocks(path)
    if path.parent != MANUAL and "from .scene" not in code
]


@pytest.mark.parametrize(("page", "code"), SINGLE, ids=[page for page, _ in SINGLE])
def test_block_of_a_readme_runs(page, code, tmp_path):
    """A block that connects no client begins after the lines of the reference."""
    ((beginning, _),) = blocks(MANUAL / "reference.md")
    run_program(code if "connect(" in code else beginning + code, tmp_path)


def test_scenario_of_the_readme_holds_its_checks():
    (code,) = (code for code, _ in blocks(ROOT / "scenarios" / "README.md") if "from .scene" in code)
    module = ModuleType("bullet_tendon.scenarios.hanging")
    module.__package__ = "bullet_tendon.scenarios"
    exec(code, vars(module))
    assert not runner.run(module, Options()).status


@pytest.mark.parametrize("page", [path for path in PAGES if blocks(path)], ids=relative)
def test_blocks_of_a_page_print_what_it_says(page, tmp_path):
    pytest.importorskip("matplotlib", reason="pages draw figures")
    found = blocks(page)
    said = run_program("".join(f"{code}\nprint({MARK!r})\n" for code, _ in found), tmp_path).split(MARK)
    for (_, expected), got in zip(found, said, strict=False):
        if expected:
            assert got.strip() == expected.strip()


def test_commands_of_pages_are_there():
    """Each `python -m bullet_tendon...` names a module that tells its usage, and scenarios that exist."""
    texts = [path.read_text(encoding="utf-8") for path in {*READMES, *PAGES}]
    commands = {found for text in texts for found in re.findall(r"python -m (bullet_tendon[\w.]*)(.*)", text)}
    assert len(commands) > 5
    for module in sorted({name for name, _ in commands}):
        run_python("-m", module, "--help")
    known = runner.known()
    for module, rest in commands:
        words = rest.split()
        if module == "bullet_tendon.scenarios" and words and re.fullmatch("[a-z_0-9]+", words[0]):
            assert words[0] in known


PASTED = [
    *((path.stem, path.read_text(encoding="utf-8")) for path in sorted((MANUAL / "recipes").glob("*.py"))),
    *((f"{path.stem}{k}", code) for path in PAGES for k, (code, _) in enumerate(blocks(path))),
]


@pytest.mark.parametrize("code", [code for _, code in PASTED], ids=[name for name, _ in PASTED])
def test_lines_can_be_pasted_into_a_console(code):
    """A console ends a loop or a function at its first blank line, and nothing else may follow before."""
    lines = [*code.split("\n"), ""]
    for node in ast.parse(code).body:
        if hasattr(node, "body"):
            assert "" not in lines[node.lineno - 1 : node.end_lineno]
            assert lines[node.end_lineno] == ""


def test_recipes_are_listed_and_tested():
    listed = re.findall(r'^    "(\w+)",$', (MANUAL / "gallery.py").read_text(encoding="utf-8"), re.MULTILINE)
    tests = (Path(__file__).parent / "test_recipes.py").read_text(encoding="utf-8")
    files = {path.stem for path in (MANUAL / "recipes").glob("*.py")}
    assert set(listed) == files
    assert files <= set(re.findall(r"def test_(\w+)\(", tests))


def test_every_public_class_and_function_is_in_the_reference():
    listed = set(
        re.findall(r"^   (\w[\w.]*)$", (MANUAL / "reference.md").read_text(encoding="utf-8"), re.MULTILINE)
    )
    assert set(bt.__all__) <= listed
    assert {f"view.{name}" for name in bt.view.__all__ if callable(getattr(bt.view, name))} <= listed


def test_public_names_are_those_that_users_call():
    names = completeness.public_names()
    assert {"bullet_tendon.TendonWorld.step", "bullet_tendon.Tendon.tension", "bullet_tendon.sweep"} <= set(
        names
    )
    assert not [name for name in names if "._" in name or "core_arguments" in name]


def test_sources_are_copied_once_and_what_is_gone_is_taken_away(tmp_path):
    copy_sources(ROOT, tmp_path)
    page = tmp_path / "scenarios" / "manual" / "index.md"
    before, old = page.stat(), tmp_path / "scenarios" / "manual" / "gone.md"
    old.write_text("# Gone\n")
    kept = tmp_path / "scenarios" / "manual" / "generated" / "scenarios" / "atwood.png"
    kept.parent.mkdir(parents=True)
    kept.write_bytes(b"")
    copy_sources(ROOT, tmp_path)
    assert page.stat().st_ino == before.st_ino and page.stat().st_mtime_ns == before.st_mtime_ns
    assert not old.exists()
    assert kept.exists()


def test_the_manual_is_built_in_the_project_folder_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main([str(tmp_path)])
    assert "run it in the project's folder" in capsys.readouterr().err


def test_the_manual_names_its_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "sphinx.cmd.build", None)
    with pytest.raises(bt.MissingExtra, match=r"bullet_tendon\[docs\]"):
        build(ROOT, tmp_path)
