"""The rooms of the core: what may include what."""

import re
from pathlib import Path

import pytest

CORE = Path(__file__).resolve().parents[2] / "bullet_tendon" / "core"

# A room may include itself and rooms of earlier levels.
LEVELS = [
    {"math"},
    {"linear", "geometry"},
    {"tendon", "bodies"},
    {"collision", "contact", "element"},
    {"integrator", "ligament", "cartilage"},
    {"solver"},
    {"world"},
    {"bindings"},
]
LEVEL = {room: level for level, rooms in enumerate(LEVELS) for room in rooms}
SHORT = 40  # lines; only headers of one type are shorter
TYPE = re.compile(r"^(?:struct|class) \w+ (?::[^;{]*)?\{", re.MULTILINE)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)


def sources(core: Path) -> list[Path]:
    return sorted(path for ending in ("*.h", "*.cpp") for path in core.rglob(ending))


def misplaced(core: Path) -> list[str]:
    """Files outside of the rooms."""
    found = [path.relative_to(core) for path in sources(core)]
    return [str(path) for path in found if len(path.parts) != 2 or path.parts[0] not in LEVEL]


def wrong_includes(core: Path) -> list[str]:
    """Includes that lead to no file of the core, or to a room that is not of an earlier level."""
    wrong = []
    for path in sources(core):
        room = path.relative_to(core).parts[0]
        for name in INCLUDE.findall(path.read_text(encoding="utf-8")):
            target = name.split("/")[0]
            earlier = LEVEL.get(target, -1) < LEVEL.get(room, -1)
            if not (target == room or earlier) or not (core / name).is_file():
                wrong.append(f'{path.relative_to(core)}: "{name}"')
    return wrong


def too_short(core: Path) -> list[str]:
    """Short files that are not headers of one type."""
    found = []
    for path in sources(core):
        text = path.read_text(encoding="utf-8")
        types = len(TYPE.findall(text)) + text.count("\ntypedef ")
        if text.count("\n") < SHORT and (path.suffix != ".h" or types != 1):
            found.append(str(path.relative_to(core)))
    return found


def test_every_file_lies_in_a_room():
    assert len(sources(CORE)) > 50
    assert misplaced(CORE) == []


def test_no_room_includes_a_later_one():
    assert wrong_includes(CORE) == []


def test_only_headers_of_one_type_are_short():
    assert too_short(CORE) == []


@pytest.fixture
def small_core(tmp_path):
    (tmp_path / "math").mkdir()
    (tmp_path / "solver").mkdir()
    (tmp_path / "math" / "vec3.h").write_text("#pragma once\n#include <cmath>\nstruct Vec3 {};\n")
    (tmp_path / "solver" / "newton.cpp").write_text('#include "math/vec3.h"\n' + SHORT * "\n")
    return tmp_path


def test_the_checks_accept_what_is_right(small_core):
    assert misplaced(small_core) == wrong_includes(small_core) == too_short(small_core) == []


def test_the_checks_find_what_is_wrong(small_core):
    (small_core / "solver" / "newton.h").write_text("#pragma once\n")
    (small_core / "math" / "wrong.cpp").write_text('#include "math/vec3.h"\n#include "solver/newton.h"\n')
    (small_core / "solver" / "lost.cpp").write_text('#include "math/none.h"\n')
    (small_core / "bodies").mkdir()
    (small_core / "tendon").mkdir()
    (small_core / "bodies" / "link.h").write_text('#include "math/vec3.h"\n')
    (small_core / "tendon" / "tendon.h").write_text('#include "bodies/link.h"\n')
    (small_core / "flat.h").write_text("#pragma once\n")
    assert wrong_includes(small_core) == [
        'math/wrong.cpp: "solver/newton.h"',
        'solver/lost.cpp: "math/none.h"',
        'tendon/tendon.h: "bodies/link.h"',
    ]
    assert misplaced(small_core) == ["flat.h"]
    (small_core / "math" / "vec3.h").write_text("struct Vec3 {};\nclass Vec4 : Vec3 {};\n")
    (small_core / "math" / "wrong.cpp").write_text((SHORT - 1) * "\n")
    (small_core / "math" / "sym3.h").write_text("struct Sym3 : Vec3 {\n};\n")
    assert {"math/vec3.h", "math/wrong.cpp", "solver/newton.h"} <= set(too_short(small_core))
    assert "math/sym3.h" not in too_short(small_core)
