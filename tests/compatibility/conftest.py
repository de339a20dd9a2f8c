"""What each released version left behind, unpacked; see `leave.py`."""

import tarfile
from pathlib import Path

import pytest

HERE = Path(__file__).parent
VERSIONS = sorted(path.name for path in HERE.iterdir() if path.name[0].isdigit())


@pytest.fixture(scope="session", params=VERSIONS)
def version(request: pytest.FixtureRequest) -> Path:
    """Give the folder of a version."""
    return HERE / str(request.param)


@pytest.fixture(scope="session")
def left(version: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the data of a version; nobody changes them."""
    folder = tmp_path_factory.mktemp("left")
    with tarfile.open(version / "data.tar.xz") as archive:
        archive.extractall(folder, filter="data")
    return folder
