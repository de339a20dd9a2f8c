"""Runs a command as a systemd unit would: its line, environment and, where the kernel can, filters.

`python -m tests.support.confined FILE COMMAND ...` confines itself by FILE, then runs the command.
"""

import ctypes
import json
import os
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ALLOW, REFUSE_EPERM, EQUAL = 0x7FFF0000, 0x00050000 | 1, 4
NO_NEW_PRIVILEGES, REFUSE_EXEC_GAIN = (38, 1), (65, 1)
FAMILIES = {"AF_UNIX": 1, "AF_INET": 2, "AF_INET6": 10, "AF_NETLINK": 16}
INSTALLED = "/opt/rover/current"


class Unit:
    """A unit file: the values of each key, in order."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.values: dict[str, list[str]] = defaultdict(list)
        for line in path.read_text().splitlines():
            if "=" in line and line[0] != "#":
                key, _, value = line.partition("=")
                self.values[key].append(value)

    def command(self, instance: str, prefix: Path) -> list[str]:
        """Return the arguments of its ExecStart, for an installation in another folder."""
        (line,) = self.values["ExecStart"]
        line = line.replace("%I", instance).replace("%i", instance).replace(INSTALLED, str(prefix))
        return [word.replace("$$", "$") for word in shlex.split(line)]

    def environment(self, instance: str, settings: Path) -> dict[str, str]:
        """Return the variables that it sets, with its files in another folder than /etc/rover."""
        lines = list(self.values["Environment"])
        for name in self.values["EnvironmentFile"]:
            path = settings / Path(name.removeprefix("-").replace("%i", instance)).name
            lines += path.read_text().splitlines() if path.exists() else []
        return dict(line.split("=", 1) for line in lines if line and line[0] != "#")

    def limits(self) -> dict[str, list[str]]:
        """Return the calls and socket families that it allows."""
        allowed: set[str] = set()
        for value in self.values["SystemCallFilter"]:
            names = {call for name in value.lstrip("~").split() for call in system_calls(name)}
            allowed = allowed - names if value[0] == "~" else allowed | names
        (families,) = self.values["RestrictAddressFamilies"]
        return {"calls": sorted(allowed), "families": families.split()}


def system_calls(name: str) -> set[str]:
    """Return a system call, or those of a set of systemd's, such as @file-system."""
    if name[0] != "@":
        return {name}
    listed = subprocess.check_output(["systemd-analyze", "syscall-filter", name], text=True)
    names = re.findall(r"^    ([@\w-]+)$", listed, re.MULTILINE)
    return {call for each in names for call in system_calls(each)}


class _Comparison(ctypes.Structure):
    _fields_ = (
        ("argument", ctypes.c_uint),
        ("operation", ctypes.c_int),
        ("value", ctypes.c_uint64),
        ("unused", ctypes.c_uint64),
    )


def confine(limits: dict[str, list[str]]) -> None:
    """Refuse this process other system calls and sockets, writable code, new privileges."""
    libc, seccomp = ctypes.CDLL(None), ctypes.CDLL("libseccomp.so.2")
    seccomp.seccomp_init.restype = ctypes.c_void_p
    for option, value in (NO_NEW_PRIVILEGES, REFUSE_EXEC_GAIN):
        libc.prctl(option, value, 0, 0, 0)
    rules = ctypes.c_void_p(seccomp.seccomp_init(REFUSE_EPERM))
    for name in limits["calls"]:
        number = seccomp.seccomp_syscall_resolve_name(name.encode())
        if name == "socket":
            for family in limits["families"]:
                only = _Comparison(0, EQUAL, FAMILIES[family], 0)
                seccomp.seccomp_rule_add_array(rules, ALLOW, number, 1, ctypes.byref(only))
        elif number >= 0:
            seccomp.seccomp_rule_add_array(rules, ALLOW, number, 0, None)
    if seccomp.seccomp_load(rules) != 0:
        raise SystemExit("the filter of system calls cannot be loaded")


if __name__ == "__main__":
    confine(json.loads(Path(sys.argv[1]).read_text()))
    os.execvp(sys.argv[2], sys.argv[2:])
