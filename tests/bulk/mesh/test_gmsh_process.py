"""The process in which gmsh reads a file: its answer, its errors and its ends."""

from pathlib import Path

from mpi4py import MPI

import pytest
from bodies import block, make_mesh

import receding_fenicsx as rf

comm = MPI.COMM_WORLD
GEO = """
DefineConstant[ width = {4, Name "width"}, contact_elements = 8 ];
Rectangle(1) = {0, 0, 0, width, 1};
Physical Curve("foot") = {1}; Physical Curve("head") = {3};
"""
FACTORY = 'SetFactory("OpenCASCADE");'


def geo_scene(path: Path, text: str) -> rf.Scene:
    rf.on_root(comm, lambda: path.write_text(FACTORY + text))
    comm.barrier()
    return block(
        body=rf.Body(mesh=str(path)),
        contacts=(rf.Contact(edge="foot"),),
        load=rf.Load("p", "head", pressure=1.0),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Exit;", "ends gmsh before the mesh is made (Exit); change"),
        ('Error("too thin"); Exit;', "gmsh cannot use it: too thin; mend"),
        ('SystemCall "kill -SEGV $PPID";', "(its process ended by SIGSEGV); mend"),
    ],
)
def test_file_that_ends_gmsh_is_refused_on_all_ranks(
    text: str, words: str, shared_tmp_path: Path
) -> None:
    scene = geo_scene(shared_tmp_path / "my.geo", GEO + text)
    with pytest.raises(rf.InputError) as caught:
        make_mesh(comm, scene, False)
    texts = set(comm.allgather(str(caught.value)))
    assert len(texts) == 1 and "\n" not in str(caught.value)
    assert '[body] mesh "my.geo": ' in str(caught.value) and words in str(caught.value)
