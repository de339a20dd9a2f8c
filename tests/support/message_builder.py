"""Builds tf2_msgs, which the ROS wheels lack: with rosidl's generators of the wheels, no cmake.

    python -m tests.support.message_builder OUT

OUT is then put on PYTHONPATH. Needs g++, Python.h, and empy 3, the template engine of rosidl.
"""

import importlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final

PREFIX: Final = Path(sys.prefix)
PACKAGE: Final = "tf2_msgs"
DEFINITION: Final = "geometry_msgs/TransformStamped[] transforms\n"
APT_EMPY: Final = Path("/usr/lib/python3/dist-packages/em.py")
"""Module of the package python3-empy, which another version of Python can import, too."""
REQUIRED: Final = "ROVER_CI" in os.environ
LIMIT_S: Final = 300.0


def missing() -> str | None:
    """Return what is missing to build messages, or None."""
    python_h = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if shutil.which("g++") is None or not python_h.is_file():
        return "needs g++ and Python.h, as by apt install g++ python3-dev"
    if importlib.util.find_spec("em") is None and not APT_EMPY.is_file():
        return "needs empy 3, as by apt install python3-empy"
    return None


def built_tf2_msgs(folder: Path) -> Path:
    """Build tf2_msgs in a process of its own, and return the folder for PYTHONPATH."""
    command = (sys.executable, "-m", "tests.support.message_builder", str(folder))
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def _generate(out: Path) -> tuple[Path, dict[str, Path]]:
    """Write the sources of the package; return their folder, and the folders of its libraries."""
    convert = _function("rosidl_adapter.msg", "convert_msg_to_idl")
    generate_py = _function("rosidl_generator_py.generate_py_impl", "generate_py")

    work = out / "build"
    source, idl, hashes = work / "source", work / "idl", work / "hashes"
    (source / "msg").mkdir(parents=True)
    (source / "msg" / "TFMessage.msg").write_text(DEFINITION)
    convert(source, PACKAGE, Path("msg/TFMessage.msg"), idl / "msg")

    def arguments(generator: str, folder: Path, **more: object) -> str:
        path = work / f"{generator}.json"
        folder.mkdir(parents=True, exist_ok=True)
        template = PREFIX / "share" / generator / "resource"
        given = {
            "package_name": PACKAGE,
            "output_dir": str(folder),
            "template_dir": str(template),
            "idl_tuples": [f"{idl}:msg/TFMessage.idl"],
            "target_dependencies": [],
            **more,
        }
        path.write_text(json.dumps(given))
        return str(path)

    shares = {p.parent.parent.name: p.parent.parent for p in PREFIX.glob("share/*/msg/*.json")}
    paths = [f"{name}:{path}" for name, path in shares.items()]
    generate_type_hash = _function("rosidl_generator_type_description", "generate_type_hash")
    generate_type_hash(arguments("rosidl_generator_type_description", hashes, include_paths=paths))
    described = [f"msg/TFMessage.idl:{hashes / 'msg/TFMessage.json'}"]
    code, module = work / "code", out / PACKAGE
    parts = {
        "generator_c": code / "generator_c" / PACKAGE,
        "typesupport_fastrtps_c": code / "fastrtps_c" / PACKAGE,
        "typesupport_introspection_c": code / "introspection_c" / PACKAGE,
    }
    c = arguments("rosidl_generator_c", parts["generator_c"], type_description_tuples=described)
    _function("rosidl_generator_c", "generate_c")(c)
    for part, name in (
        ("typesupport_fastrtps_c", "generate_typesupport_fastrtps_c"),
        ("typesupport_introspection_c", "generate_c"),
    ):
        _function(f"rosidl_{part}", name)(arguments(f"rosidl_{part}", parts[part]))
    for part, folder in parts.items():
        _write_export_header(folder, part)
    kinds = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
    c = arguments("rosidl_typesupport_c", code / "typesupport_c" / PACKAGE)
    _function("rosidl_typesupport_c", "generate_c")(c, kinds)
    generate_py(arguments("rosidl_generator_py", module), ["rosidl_typesupport_c"])
    (module / "__init__.py").touch()
    return code, parts


def _function(module: str, name: str) -> Callable[..., Any]:
    """Return a function of rosidl, whose modules have no types."""
    function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function


def _write_export_header(folder: Path, part: str) -> None:
    name = f"rosidl_{part}__visibility_control.h"
    text = (PREFIX / "share" / f"rosidl_{part}" / "resource" / f"{name}.in").read_text()
    text = text.replace("@PROJECT_NAME@", PACKAGE).replace("@PROJECT_NAME_UPPER@", PACKAGE.upper())
    (folder / "msg").mkdir(parents=True, exist_ok=True)
    (folder / "msg" / name).write_text(text)


def _compile(flags: Sequence[str], source: Path) -> str:
    compiler = ["g++", "-std=c++17"] if source.suffix == ".cpp" else ["gcc"]
    subprocess.run([*compiler, *flags, "-c", str(source), "-o", f"{source}.o"], check=True)
    return f"{source}.o"


def _link(compiled: Any, target: Path, folder: Path, libraries: Sequence[Path]) -> None:
    objects = compiled([*folder.rglob("*.c"), *folder.rglob("*.cpp")])
    options = ["-shared", "-Wl,--no-as-needed", "-Wl,-rpath,$ORIGIN", f"-Wl,-soname,{target.name}"]
    subprocess.run(["g++", *options, "-o", str(target), *objects, *map(str, libraries)], check=True)


def build(out: Path) -> None:
    """Build the package into a folder."""
    import numpy

    if importlib.util.find_spec("em") is None:
        spec = importlib.util.spec_from_file_location("em", APT_EMPY)
        assert spec is not None
        assert spec.loader is not None
        sys.modules["em"] = em = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(em)
    code, parts = _generate(out)
    module, lib = out / PACKAGE, PREFIX / "lib"
    includes = [PREFIX / "include", module, *code.iterdir()]
    includes += [each for each in (PREFIX / "include").iterdir() if each.is_dir()]
    includes += [Path(sysconfig.get_paths()["include"]), Path(numpy.get_include())]
    flags = ["-fPIC", "-O0", "-w", *(f"-I{each}" for each in includes)]
    ends = (
        *("generator_c", "generator_py", "typesupport_c"),
        *("typesupport_fastrtps_c", "typesupport_introspection_c"),
    )
    libraries = [each for each in lib.glob("lib*__rosidl_*.so") if each.stem.endswith(ends)]
    libraries += [
        lib / f"lib{name}.so"
        for name in (
            *("rosidl_runtime_c", "rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c"),
            *("rosidl_typesupport_fastrtps_cpp", "rosidl_typesupport_introspection_c"),
            *("fastcdr", "rcutils", "rmw"),
        )
    ]
    with ThreadPoolExecutor(2) as pool:

        def compiled(sources: list[Path]) -> list[str]:
            return list(pool.map(partial(_compile, flags), sources))

        for part, folder in parts.items():
            target = module / f"lib{PACKAGE}__rosidl_{part}.so"
            _link(compiled, target, folder, libraries)
            libraries.insert(0, target)
        extension = code / "typesupport_c" / "python"
        extension.mkdir()
        for each in list(module.rglob("*.c")):
            each.rename(extension / each.name)
        suffix = sysconfig.get_config_var("EXT_SUFFIX")
        name = f"{PACKAGE}_s__rosidl_typesupport_c{suffix}"
        _link(compiled, module / name, code / "typesupport_c", libraries)


if __name__ == "__main__":
    build(Path(sys.argv[1]).absolute())
