"""The rooms of the core: what may include what, and how much a struct may hold."""

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
MOST_MEMBERS = 25  # data members of a struct
TYPE = re.compile(r"^(?:struct|class) \w+ (?::[^;{]*)?\{", re.MULTILINE)
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)
# Comments and preprocessor lines.
ASIDE = re.compile(r"//[^\n]*|/\*.*?\*/|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE | re.DOTALL)
STRUCT = re.compile(r"(?<!enum )\b(?:struct|class) (\w+)(?: final)?(?: : [^{;]*)? \{")
NO_DATA = re.compile(
    r"(?:using|typedef|friend|static|(?:struct|class|enum|union) [\w ]+$)\b|[^=]*\(|.*\boperator\b", re.DOTALL
)


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


def emptied(text: str, opening: str, closing: str) -> str:
    """The text without what such brackets enclose, up to the end of a bracket that begins before it."""
    depth, out = 0, []
    for c in text:
        depth -= c == closing
        if depth < 0:
            break
        if depth == 0:
            out.append(c)
        depth += c == opening
    return "".join(out)


def data_members(body: str) -> int:
    """How many members a struct declares that are data, its own only. A member of a struct's type is one."""
    body = emptied(body, "{", "}")
    body = emptied(emptied(body, "(", ")"), "[", "]")
    while "<" in body and body != (shorter := re.sub(r"<[^<>;]*>", "", body)):
        body = shorter
    body = re.sub(r"\b(?:public|protected|private):", "", body)
    body = re.sub(r"(\)[^;{}=]*)\{\}", r"\1;", body)  # a function with a body
    count = 0
    for declaration in body.split(";"):
        # Of a type that is declared here, what follows it is of that type.
        declared = re.sub(r"^(?:struct|class|enum|union)\b[^{]*\{\}", "", declaration.strip()).strip()
        if declared and not NO_DATA.match(declared):
            count += 1 + re.sub(r"=[^,]*", "", declared).count(",")
    return count


def structs(core: Path) -> list[tuple[str, int]]:
    """The structs and classes of the headers, nested ones too, and how many data members each has."""
    found = []
    for path in sources(core):
        text = ASIDE.sub("", path.read_text(encoding="utf-8")) if path.suffix == ".h" else ""
        found += [
            (f"{path.relative_to(core)}: {m[1]}", data_members(text[m.end() :]))
            for m in STRUCT.finditer(text)
        ]
    return found


def test_every_file_lies_in_a_room():
    assert len(sources(CORE)) > 50
    assert misplaced(CORE) == []


def test_no_room_includes_a_later_one():
    assert wrong_includes(CORE) == []


def test_only_headers_of_one_type_are_short():
    assert too_short(CORE) == []


def test_no_struct_has_too_many_data_members():
    found = structs(CORE)
    assert len(found) > 100
    assert [(name, count) for name, count in found if count > MOST_MEMBERS] == []


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


MEMBERS = """#pragma once
#define PAIR(a, b) \\
  int a;           \\
  int b;
struct Vec3;
template <class T, class U = std::vector<T>>
class Row final : public std::vector<T>, Base<U> {
 public:
  using Numbers = std::vector<double>;
  static constexpr int kMost = 3;  // int commented;
  struct Slot { int first, second = 2; };
  enum class Kind { one, two };
  Row(int n) : n_(n), end_(0) {}
  explicit Row(const Row&) = default;
  Row& operator=(const Row&) = default;
  template <class Do>
  void each(Do what) const { for (int i = 0; i < n_; ++i) what(i); }
  bool is_less(double a, double b) const { return a < b; }
  virtual Kind kind() = 0;
  friend struct Reader;
  /* int also, commented; */
  Slot slot;
  struct { int x; } unnamed;
  std::map<int, std::vector<double>> by_number, others{{1, {2, 3}}};
  Vec3 corners[2][4] = {{1, 2}, {3, 4}}, *centre = nullptr, middle = Vec3{f(1, 2), 0};
  std::function<void(int, int)> call;
  mutable bool known = f(1, 2);

 private:
  int n_, end_;
};
"""


def test_data_members_are_counted(tmp_path):
    (tmp_path / "row.h").write_text(MEMBERS)
    assert structs(tmp_path) == [("row.h: Row", 11), ("row.h: Slot", 2)]
    (tmp_path / "row.h").write_text("struct Long {\n" + "  int a, b;\n" * MOST_MEMBERS + "};\n")
    assert structs(tmp_path) == [("row.h: Long", 2 * MOST_MEMBERS)]
