"""Builds packages of ROS interfaces that the wheels lack: with rosidl's generators, no cmake.

    python -m tests.support.message_builder DEFINITIONS OUT

DEFINITIONS has `<package>/{msg,action}/<Name>.{msg,action}`; the packages may use only those of the
wheels. OUT is then put on PYTHONPATH. Needs g++, Python.h, and empy 3, the template engine of
rosidl.
"""

import importlib
import importlib.util
import json
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

PREFIX: Final = Path(sys.prefix)
KINDS: Final = "msg", "action"
APT_EMPY: Final = Path("/usr/lib/python3/dist-packages/em.py")
"""Module of the package python3-empy, which another version of Python can import, too."""
LINKED: Final = (
    *("generator_c", "generator_py", "typesupport_c"),
    *("typesupport_fastrtps_c", "typesupport_introspection_c"),
)
"""Libraries of each package of the wheels that those of another one use."""
RUNTIME: Final = (
    *("rosidl_runtime_c", "rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c"),
    *("rosidl_typesupport_fastrtps_cpp", "rosidl_typesupport_introspection_c"),
    *("fastcdr", "rcutils", "rmw"),
)
Options = Callable[..., str]
"""Writes the options of a generator to a file, and returns its path."""


def missing() -> str | None:
    """Return the missing tool or package of a build, or None."""
    python_h = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if shutil.which("g++") is None or not python_h.is_file():
        return "needs g++ and Python.h, as by apt install g++ python3-dev"
    if importlib.util.find_spec("em") is None and not APT_EMPY.is_file():
        return "needs empy 3, as by apt install python3-empy"
    if not (PREFIX / "share" / "rosidl_generator_c").is_dir():
        return "needs the ROS wheels, or the package from apt"
    return None


def build(definitions: Path, out: Path) -> None:
    """Build the packages of a folder of definitions into a folder."""
    if importlib.util.find_spec("em") is None:
        spec = importlib.util.spec_from_file_location("em", APT_EMPY)
        assert spec is not None
        assert spec.loader is not None
        sys.modules["em"] = em = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(em)
    for source in sorted(each for each in definitions.iterdir() if each.is_dir()):
        _build(source.absolute(), out.absolute())
    shutil.rmtree(out / "build")


def _build(source: Path, out: Path) -> None:
    package, work = source.name, out / "build" / source.name
    code, module = work / "code", out / package
    parts = {
        "generator_c": code / "generator_c" / package,
        "typesupport_fastrtps_c": code / "fastrtps_c" / package,
        "typesupport_introspection_c": code / "introspection_c" / package,
    }
    interfaces = _convert(source, work / "idl")

    def options(generator: str, folder: Path, **more: object) -> str:
        path = work / f"{generator}.json"
        folder.mkdir(parents=True, exist_ok=True)
        given = {
            "package_name": package,
            "output_dir": str(folder),
            "template_dir": str(PREFIX / "share" / generator / "resource"),
            "idl_tuples": [f"{work / 'idl'}:{each}.idl" for each in interfaces],
            "target_dependencies": [],
            **more,
        }
        path.write_text(json.dumps(given))
        return str(path)

    _generate(options, interfaces, work / "hashes", parts)
    for part, folder in parts.items():
        _write_export_header(folder, part, package)
    kinds = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
    c = options("rosidl_typesupport_c", code / "typesupport_c" / package)
    _function("rosidl_typesupport_c", "generate_c")(c, kinds)
    generate_py = _function("rosidl_generator_py.generate_py_impl", "generate_py")
    generate_py(options("rosidl_generator_py", module), ["rosidl_typesupport_c"])
    (module / "__init__.py").touch()
    _compile(package, code, parts, module)


def _convert(source: Path, idl: Path) -> list[str]:
    """Convert the definitions of a package to IDL; return the names, as `msg/Name`."""
    names = []
    for kind in KINDS:
        convert = _function(f"rosidl_adapter.{kind}", f"convert_{kind}_to_idl")
        for path in sorted((source / kind).glob(f"*.{kind}")):
            convert(source, source.name, path.relative_to(source), idl / kind)
            names.append(f"{kind}/{path.stem}")
    return names


def _generate(
    options: Options, interfaces: Sequence[str], hashes: Path, parts: dict[str, Path]
) -> None:
    """Write the sources of the libraries, with the hashes of the types (REP 2011)."""
    described = PREFIX.glob("share/*/[ms][sr][gv]/*.json")
    folders = sorted({path.parent.parent for path in described})
    paths = [f"{folder.name}:{folder}" for folder in folders]
    generate_type_hash = _function("rosidl_generator_type_description", "generate_type_hash")
    generate_type_hash(options("rosidl_generator_type_description", hashes, include_paths=paths))
    tuples = [f"{each}.idl:{hashes / each}.json" for each in interfaces]
    generator_c = options(
        "rosidl_generator_c", parts["generator_c"], type_description_tuples=tuples
    )
    _function("rosidl_generator_c", "generate_c")(generator_c)
    for part, name in (
        ("typesupport_fastrtps_c", "generate_typesupport_fastrtps_c"),
        ("typesupport_introspection_c", "generate_c"),
    ):
        _function(f"rosidl_{part}", name)(options(f"rosidl_{part}", parts[part]))


def _function(module: str, name: str) -> Callable[..., Any]:
    """Return a function of rosidl. Its modules have no types."""
    function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function


def _write_export_header(folder: Path, part: str, package: str) -> None:
    name = f"rosidl_{part}__visibility_control.h"
    text = (PREFIX / "share" / f"rosidl_{part}" / "resource" / f"{name}.in").read_text()
    text = text.replace("@PROJECT_NAME@", package).replace("@PROJECT_NAME_UPPER@", package.upper())
    (folder / "msg").mkdir(parents=True, exist_ok=True)
    (folder / "msg" / name.replace("@PROJECT_NAME@", package)).write_text(text)


def _compile(package: str, code: Path, parts: dict[str, Path], module: Path) -> None:
    """Compile each library, and the module of Python; each is linked with those before it."""
    import numpy

    includes = [PREFIX / "include", module, *code.iterdir()]
    includes += [each for each in (PREFIX / "include").iterdir() if each.is_dir()]
    includes += [Path(sysconfig.get_paths()["include"]), Path(numpy.get_include())]
    flags = ["-fPIC", "-O0", "-w", *(f"-I{each}" for each in includes)]
    lib = PREFIX / "lib"
    libraries = [each for each in lib.glob("lib*__rosidl_*.so") if each.stem.endswith(LINKED)]
    libraries += [lib / f"lib{name}.so" for name in RUNTIME]
    for part, folder in parts.items():
        target = module / f"lib{package}__rosidl_{part}.so"
        _link(flags, target, folder, libraries)
        libraries.insert(0, target)
    extension = code / "typesupport_c" / "python"
    extension.mkdir()
    for each in list(module.rglob("*.c")):
        each.rename(extension / each.name)
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    name = f"{package}_s__rosidl_typesupport_c{suffix}"
    _link(flags, module / name, code / "typesupport_c", libraries)


def _link(flags: Sequence[str], target: Path, folder: Path, libraries: Sequence[Path]) -> None:
    def compiled(source: Path) -> str:
        compiler = ["g++", "-std=c++17"] if source.suffix == ".cpp" else ["gcc"]
        subprocess.run([*compiler, *flags, "-c", str(source), "-o", f"{source}.o"], check=True)
        return f"{source}.o"

    with ThreadPoolExecutor(2) as pool:
        objects = list(pool.map(compiled, [*folder.rglob("*.c"), *folder.rglob("*.cpp")]))
    options = ["-shared", "-Wl,--no-as-needed", "-Wl,-rpath,$ORIGIN", f"-Wl,-soname,{target.name}"]
    subprocess.run(["g++", *options, "-o", str(target), *objects, *map(str, libraries)], check=True)


if __name__ == "__main__":
    build(Path(sys.argv[1]), Path(sys.argv[2]))
