"""The JPEG file around a scan that came by RTP, which leaves out what is always the same.

As RFC 2435, appendices B and C, make it; the Huffman tables are those of ITU-T T.81, annex K.3.
"""

from dataclasses import dataclass
from typing import Final

TABLE: Final = 64
"""Octets of a quantization table."""
END: Final = b"\xff\xd9"
_HUFFMAN: Final = (
    "0000010501010101010100000000000000000102030405060708090a0b",
    "100002010303020403050504040000017d01020300041105122131410613516107227114328191a1082342b1c115"
    "52d1f02433627282090a161718191a25262728292a3435363738393a434445464748494a535455565758595a6364"
    "65666768696a737475767778797a838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5b6b7"
    "b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae1e2e3e4e5e6e7e8e9eaf1f2f3f4f5f6f7f8f9fa",
    "0100030101010101010101010000000000000102030405060708090a0b",
    "1100020102040403040705040400010277000102031104052131061241510761711322328108144291a1b1c10923"
    "3352f0156272d10a162434e125f11718191a262728292a35363738393a434445464748494a535455565758595a63"
    "6465666768696a737475767778797a82838485868788898a92939495969798999aa2a3a4a5a6a7a8a9aab2b3b4b5"
    "b6b7b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae2e3e4e5e6e7e8e9eaf2f3f4f5f6f7f8f9fa",
)
"""Class and number of each table, its code lengths, its values."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What is needed besides the scan.

    Attributes:
        sampling: how densely luminance is sampled, as in the frame header (T.81, B.2.2).
        tables: the quantization tables of luminance and chrominance, in zigzag order.
        restart: units between two restart markers, 0 where there are none.
    """

    width: int
    height: int
    sampling: int
    tables: tuple[bytes, bytes]
    restart: int


def jpeg_file(layout: Layout, scan: bytes) -> bytes:
    """Return a file that any program shows."""
    components = bytes((1, layout.sampling, 0, 2, 0x11, 1, 3, 0x11, 1))
    size = layout.height.to_bytes(2) + layout.width.to_bytes(2)
    return b"".join(
        (
            b"\xff\xd8",
            *(
                _segment(0xDB, bytes((number,)) + table)
                for number, table in enumerate(layout.tables)
            ),
            _segment(0xC0, b"\x08" + size + b"\x03" + components),
            *(_segment(0xC4, bytes.fromhex(table)) for table in _HUFFMAN),
            _segment(0xDD, layout.restart.to_bytes(2)) if layout.restart else b"",
            _segment(0xDA, bytes((3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0))),
            scan if scan.endswith(END) else scan + END,
        )
    )


def _segment(marker: int, content: bytes) -> bytes:
    return bytes((0xFF, marker)) + (2 + len(content)).to_bytes(2) + content
