"""The brick by the real libusb, on a USB of umockdev's: found, claimed, written, read, released."""

import ctypes.util
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from adapters.mops import Message, encode

CHECKOUT = Path(__file__).resolve().parents[3]
LIMIT_S = 60.0
NODE = "/dev/bus/usb/001/002"
COMMAND = encode(Message(0x10E, "MOE", "MOCUP", "STOP", moe_inputs_id=1))
REPLY = encode(
    Message(0x10E, "MOCUP", "MOE", "STOP", (), ("EXECUTED",), True, True, moe_inputs_id=1)
)
USE = """
import sys
from contextlib import closing
from adapters.mocup.brick.usb import Brick, BrickError, UsbAddress, libusb
try:
    with closing(Brick(UsbAddress(0x0694, int(sys.argv[1]), 0, 0x01, 0x82), libusb())) as brick:
        print("wrote", brick.write(bytes.fromhex(sys.argv[2])))
        print("read", brick.read().decode())
except BrickError as error:
    print(error)
print("released")
"""
DEVICE = f"""\
P: /devices/pci0000:00/0000:00:14.0/usb1/1-1
N: bus/usb/001/002={{descriptors}}
E: BUSNUM=001
E: DEVNAME={NODE}
E: DEVNUM=002
E: DEVTYPE=usb_device
E: MAJOR=189
E: MINOR=1
E: SUBSYSTEM=usb
A: bConfigurationValue=1\\n
A: busnum=1\\n
A: devnum=2\\n
A: speed=12\\n
H: descriptors={{descriptors}}
"""

pytestmark = pytest.mark.skipif(
    shutil.which("umockdev-run") is None or ctypes.util.find_library("usb-1.0") is None,
    reason="needs umockdev and libusb-1.0-0 from apt",
)


def descriptors() -> bytes:
    """Return those of LEGO's NXT: device, configuration, interface, two bulk endpoints."""
    device = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 8, 0x0694, 2, 0, 0, 0, 0, 1)
    interface = struct.pack("<9B", 9, 4, 0, 0, 2, 0xFF, 0xFF, 0xFF, 0)
    for endpoint in (0x01, 0x82):
        interface += struct.pack("<BBBBHB", 7, 5, endpoint, 2, 64, 0)
    return device + struct.pack("<BBHBBBBB", 9, 2, 9 + len(interface), 1, 1, 0, 0xC0, 0) + interface


def transfer(endpoint: int, octets: bytes) -> str:
    size = len(octets)
    return f"USBDEVFS_REAPURBNDELAY 0 3 {endpoint} 0 0 {size} {size} 0 {octets.hex().upper()}\n"


def use(folder: Path, product_id: int) -> list[str]:
    """Use a brick in a process under umockdev; return what it said."""
    device, ioctls = folder / "brick.umockdev", folder / "brick.ioctl"
    device.write_text(DEVICE.format(descriptors=descriptors().hex().upper()), encoding="ascii")
    script = transfer(0x01, COMMAND) + transfer(0x82, REPLY.ljust(64, b"\0"))
    ioctls.write_text(f"@DEV {NODE}\n{script}", encoding="ascii")
    return subprocess.run(
        [
            *("umockdev-run", "--device", str(device), "--ioctl", f"{NODE}={ioctls}", "--"),
            *(sys.executable, "-c", USE, str(product_id), COMMAND.hex()),
        ],
        cwd=CHECKOUT,
        check=True,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    ).stdout.splitlines()


def test_a_brick_is_found_written_read_and_released(tmp_path: Path) -> None:
    assert use(tmp_path, 0x0002) == [f"wrote {len(COMMAND)}", f"read {REPLY.decode()}", "released"]


def test_another_product_is_no_brick(tmp_path: Path) -> None:
    assert use(tmp_path, 0x0005) == ["no brick 0694:0005 is plugged in", "released"]
