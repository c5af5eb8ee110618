"""Builds the compiled core and maps the top-level folders `urdf` and `scenarios` into the package."""

import os
import re
import sysconfig
from glob import glob
from pathlib import Path

from setuptools import setup

try:
    from pybind11.setup_helpers import ParallelCompile, Pybind11Extension
except ImportError:
    raise SystemExit("bullet_tendon needs pybind11 to build: run `pip install .`, not `setup.py`") from None

if not Path(sysconfig.get_paths()["include"], "Python.h").exists():
    raise SystemExit("bullet_tendon needs Python's headers to build: install python3-dev (Debian)")

ParallelCompile(default=os.cpu_count() or 1).install()

# BULLET_TENDON_SANITIZE=address,undefined builds the core with those sanitizers, for tests (tests/README.md).
sanitize = os.environ.get("BULLET_TENDON_SANITIZE", "")
sanitizers = [f"-fsanitize={sanitize}", "-fno-omit-frame-pointer", "-g"] if sanitize else []
if "undefined" in sanitize:
    sanitizers.append("-fno-sanitize-recover=undefined")

# No -ffast-math and no -march: the same wheel gives the same answers on every x86-64.
# The two -fno- flags only promise that nobody reads errno or floating-point traps.
core = Pybind11Extension(
    "bullet_tendon._core",
    sorted(glob("bullet_tendon/core/**/*.cpp", recursive=True)),
    depends=sorted(glob("bullet_tendon/core/**/*.h", recursive=True)),
    include_dirs=["bullet_tendon/core"],
    cxx_std=17,
    extra_compile_args=["-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", *sanitizers],
    extra_link_args=sanitizers,
)


def long_description() -> str:
    """The README without what only a checkout shows: pictures, and links to its other files."""
    text = Path("README.md").read_text(encoding="utf-8")
    text = re.sub(r"!\[[^]]*\]\([^)]*\)\n*", "", text)
    return re.sub(r"\[([^]]*)\]\((?!https?:)[^)]*\)", r"\1", text)


setup(
    name="bullet_tendon",
    version="0.1.0",
    description="Implicit, nonlinear tendons for pybullet: tunnels, bones, contact, two-way coupling",
    long_description=long_description(),
    long_description_content_type="text/markdown",
    license_expression="MIT",
    license_files=["LICENSE"],
    author="the bullet_tendon developers",
    keywords=["tendon", "ligament", "suture", "cable", "pybullet", "simulation", "biomechanics", "surgery"],
    project_urls={
        "pybullet": "https://pybullet.org",
        "Flexible Collision Library": "https://github.com/flexible-collision-library/fcl",
    },
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Intended Audience :: Healthcare Industry",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: C++",
        "Programming Language :: Python :: 3",
        "Programming Language :: Python :: 3 :: Only",
        "Programming Language :: Python :: 3.10",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Programming Language :: Python :: 3.13",
        "Programming Language :: Python :: Implementation :: CPython",
        "Topic :: Scientific/Engineering :: Medical Science Apps.",
        "Topic :: Scientific/Engineering :: Physics",
        "Typing :: Typed",
    ],
    python_requires=">=3.10",
    install_requires=["pybullet>=3.2.5", "numpy>=1.24", "scipy>=1.10", "python-fcl>=0.7"],
    extras_require={
        "test": [
            "pytest>=7",
            "hypothesis>=6",
            "loky>=3",
            "distributed>=2023.4",
            "gymnasium>=1.1",
            "cma>=3.3",
            "k3d>=3.0",
        ],
        "view": ["matplotlib>=3.6", "tqdm>=4"],
        "replay": ["k3d>=3.0"],
        "gym": ["gymnasium>=1.1"],
        "learn": ["gymnasium>=1.1", "cma>=3.3"],
        "docs": [
            "sphinx>=8",
            "pydata-sphinx-theme>=0.16",
            "myst-parser>=4",
            "sphinx-gallery>=0.18",
            "gymnasium>=1.1",
            "matplotlib>=3.6",
            "k3d>=3.0",
        ],
        "dev": ["ruff==0.17.*"],
    },
    packages=[
        "bullet_tendon",
        "bullet_tendon.urdf",
        "bullet_tendon.scenarios",
        "bullet_tendon.scenarios.benchmarks",
        "bullet_tendon.scenarios.manual",
        "bullet_tendon.scenarios.tasks",
    ],
    package_dir={"bullet_tendon.urdf": "urdf", "bullet_tendon.scenarios": "scenarios"},
    package_data={
        "bullet_tendon": ["py.typed", "*.pyi", "*.js"],
        "bullet_tendon.urdf": ["*.urdf", "*.csv", "meshes/*.obj"],
        "bullet_tendon.scenarios.benchmarks": ["records/*.json"],
        "bullet_tendon.scenarios.tasks": ["*.npz"],
    },
    ext_modules=[core],
    zip_safe=False,
)
