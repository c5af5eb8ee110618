"""python -m bullet_tendon.scenarios.manual OUT: builds the manual of the project in the present folder.

Needs the extra `docs`. Warnings are errors. Recipes write files beside themselves, and Sphinx writes pages
beside its sources. Therefore both work on a copy of the sources, in OUT/source. The pages are in OUT/html.
What is up to date in these folders is not made again.
"""

import argparse
import shutil
import sys
from pathlib import Path

from bullet_tendon import errors

MANUAL = Path("scenarios", "manual")
GENERATED = MANUAL / "generated"  # in the copy: pages of recipes, scenarios and names
STUBS = GENERATED / "reference"  # autosummary makes them anew, and leaves those of names that are gone
SOURCES = (
    "LICENSE",
    "*.md",
    "bullet_tendon/README.md",
    "bullet_tendon/core/README.md",
    "urdf/README.md",
    "tests/README.md",
    "scenarios/README.md",
    "scenarios/*.py",
    "scenarios/*/README.md",
    "scenarios/**/*.png",
    "scenarios/manual/**/*.*",
)


def main(arguments: list[str] | None = None) -> int:
    """The command line. Returns the exit status: 0, 1 (something fails), 2 (bad usage)."""
    parser = argparse.ArgumentParser(
        "python -m bullet_tendon.scenarios.manual", description="Builds the manual."
    )
    parser.add_argument("out", metavar="OUT", type=Path, help="folder for pages and sources")
    out = parser.parse_args(arguments).out
    if not (MANUAL / "conf.py").is_file():
        parser.error(f"there is no {MANUAL / 'conf.py'} here: run it in the project's folder")
    try:
        return build(Path.cwd(), out.resolve())
    except errors.MissingExtra as problem:
        parser.error(str(problem))


def build(project: Path, out: Path) -> int:
    """Write the pages of the project in a folder to the folder html of `out`. Returns the exit status."""
    try:
        from sphinx.cmd.build import build_main
    except ImportError:
        raise errors.MissingExtra("sphinx", "docs", "building the manual") from None
    source, pages = out / "source", out / "html"
    copy_sources(project, source)
    folders = ["-d", str(out / "doctrees"), "-c", str(source / MANUAL), str(source), str(pages)]
    status = build_main(["-q", "-W", "--keep-going", *folders])
    if not status:
        print(f"open {pages / 'index.html'}")
    return status


def copy_sources(project: Path, copy: Path) -> None:
    """Bring the copy up to date. Files that are there already, with the same time, are left alone."""
    found = {file.relative_to(project) for pattern in SOURCES for file in project.glob(pattern)}
    wanted = {name for name in found if "__pycache__" not in name.parts}
    for name in wanted:
        target = copy / name
        if not target.exists() or target.stat().st_mtime_ns != (project / name).stat().st_mtime_ns:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(project / name, target)
    for file in [file for file in copy.rglob("*") if file.is_file()]:
        name = file.relative_to(copy)
        if name not in wanted and (GENERATED not in name.parents or STUBS in name.parents):
            file.unlink()


if __name__ == "__main__":
    sys.exit(main())
