"""Unpacking: what is in an archive arrives, what does not belong there does not, and nothing stays behind."""

import os
import stat
import tempfile
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bms.plants.fmu.archive import ArchiveLimits, unpack
from bms.plants.fmu.errors import FmuError

DESCRIPTION = "modelDescription.xml"


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The system's place for temporary files, empty."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def pack(path, entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in {DESCRIPTION: "<x/>", **entries}.items():
            archive.writestr(name, content)
    return path


def refusal(path, **limits):
    with pytest.raises(FmuError) as caught, unpack(path, limits=ArchiveLimits(**limits)):
        pass
    return str(caught.value)


def test_content_arrives_and_leaves_with_the_context(tmp_path, temporary):
    noise = os.urandom(3_000_000)
    path = pack(tmp_path / "Akku_größe_电池.fmu", {"resources/große/电池.bin": noise, "binaries/x/": ""})
    with unpack(path) as folder:
        assert (folder / "resources" / "große" / "电池.bin").read_bytes() == noise
        assert (folder / DESCRIPTION).read_text() == "<x/>"
        assert (folder / "binaries" / "x").is_dir()
        assert folder.parent == temporary.resolve()
        assert folder.name.startswith(f"socwise-fmu-{os.getpid()}-")
    assert list(temporary.iterdir()) == []


def test_there_is_always_a_folder_of_resources(tmp_path, temporary):
    """Instances are told of it, whether it holds something or not."""
    with unpack(pack(tmp_path / "a.fmu", {})) as folder:
        assert list((folder / "resources").iterdir()) == []


def test_an_error_inside_removes_the_folder_too(tmp_path, temporary):
    path = pack(tmp_path / "a.fmu", {})
    with pytest.raises(KeyboardInterrupt), unpack(path):
        raise KeyboardInterrupt
    assert list(temporary.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_programs_stay_executable(tmp_path, temporary):
    entry = zipfile.ZipInfo("resources/run")
    entry.external_attr = (stat.S_IFREG | 0o755) << 16
    path = pack(tmp_path / "a.fmu", {"resources/data": "1"})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(entry, "#!/bin/sh\n")
    with unpack(path) as folder:
        assert os.access(folder / "resources" / "run", os.X_OK)
        assert not os.access(folder / "resources" / "data", os.X_OK)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    parts=st.lists(
        st.sampled_from(["..", ".", "", "a", "C:", "\\", "é", " ", "..a", "a..", "~", "\n"]), max_size=5
    ),
    lead=st.sampled_from(["", "/", "//", "\\", "./"]),
)
def test_no_name_leads_outside(parts, lead, tmp_path, temporary):
    """Whatever a name looks like, it is refused or lands below the folder."""
    name = lead + "/".join(parts)
    path = tmp_path / "a.fmu"
    pack(path, {})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(zipfile.ZipInfo(name or "empty"), "evil")
    before = set(tmp_path.rglob("*"))
    try:
        with unpack(path) as folder:
            found = {file for file in folder.rglob("*") if file.is_file()}
            assert len(found) <= 2
            assert set(tmp_path.rglob("*")) - before - {folder, *folder.rglob("*")} == set()
    except FmuError as error:
        assert str(path) in str(error)
    assert set(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (("resources/a", "resources/./a"), "twice"),
        (("resources/a", "resources/a/b"), "twice"),
    ],
    ids=["the same in other words", "a file that is a folder"],
)
def test_names_that_clash(names, says, tmp_path, temporary):
    assert says in refusal(pack(tmp_path / "a.fmu", dict.fromkeys(names, "1")))
    assert list(temporary.iterdir()) == []


def test_limits_are_held(tmp_path, temporary):
    many = pack(tmp_path / "many.fmu", {f"resources/{at}": "" for at in range(20)})
    assert "20" in refusal(many, entries=20)
    with unpack(many, limits=ArchiveLimits(entries=21)) as folder:
        assert len(list((folder / "resources").iterdir())) == 20
    large = pack(tmp_path / "large.fmu", {"resources/zeros": bytes(5_000_000)})
    assert "at most 0.0 GB" in refusal(large, total_bytes=4_000_000)
    assert "times its size" in refusal(large, ratio=200.0, ratio_from_bytes=1_000_000)
    with unpack(large, limits=ArchiveLimits(ratio=2000.0, ratio_from_bytes=0)) as folder:
        assert (folder / "resources" / "zeros").stat().st_size == 5_000_000
    assert list(temporary.iterdir()) == []


def flip(path, old, new):
    """Change bytes of an archive, wherever they stand."""
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))
    return path


def test_sizes_that_lie_are_counted(tmp_path, temporary):
    """The archive says 5 bytes; what inflates is stopped at the limit or found out at the end."""
    size = 50_000_000
    path = flip(
        pack(tmp_path / "a.fmu", {"resources/zeros": bytes(size)}),
        size.to_bytes(4, "little"),
        (5).to_bytes(4, "little"),
    )
    assert "damaged" in refusal(path)
    assert list(temporary.iterdir()) == []


def test_encryption_and_foreign_compression_are_said(tmp_path, temporary):
    path = pack(tmp_path / "a.fmu", {"resources/secret": "1"})
    content = bytearray(path.read_bytes())
    at = content.rfind(b"PK\x01\x02")
    content[at + 8] |= 1
    path.write_bytes(content)
    assert "encrypted" in refusal(path)
    path = pack(tmp_path / "b.fmu", {"resources/odd": "1"})
    content = bytearray(path.read_bytes())
    content[content.rfind(b"PK\x01\x02") + 10] = 97
    path.write_bytes(content)
    assert "ordinary zip" in refusal(path)


def test_files_that_are_no_archive(tmp_path, temporary):
    (tmp_path / "text.fmu").write_text("hello")
    assert "not an FMU" in refusal(tmp_path / "text.fmu")
    assert "cannot unpack" in refusal(Path(tmp_path / "missing.fmu"))
    assert "folder" in refusal(tmp_path)
    with zipfile.ZipFile(tmp_path / "other.fmu", "w") as archive:
        archive.writestr("sub/modelDescription.xml", "<x/>")
    assert f"no {DESCRIPTION} at its top" in refusal(tmp_path / "other.fmu")
    assert list(temporary.iterdir()) == []
