"""The process in which gmsh reads a file: its answer, its errors and its ends."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from bodies import block, make_mesh

import receding_fenicsx as rf
from receding_fenicsx import workers
from receding_fenicsx.bulk.mesh import user_mesh
from receding_fenicsx.bulk.mesh.meshing import raw_meshes

comm = MPI.COMM_WORLD
DEMOS = Path(__file__).parents[3] / "demos"
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
        (
            'SystemCall "kill -SEGV $PPID";',
            "(its process ended by SIGSEGV); mend",
        ),
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


@pytest.mark.one_rank
def test_process_answers_the_mesh_that_gmsh_makes_here(tmp_path: Path) -> None:
    body = geo_scene(tmp_path / "my.geo", GEO + 'Printf("%g", width);').body
    (child,), (here,) = (
        read([body], rf.MeshOptions(contact_elements=8), False)
        for read in (user_mesh.read_user_meshes, user_mesh._meshes)
    )
    assert len(here.cells) > 8 and set(here.edges) == {"foot", "head"}
    np.testing.assert_equal(asdict(child), asdict(here))


@pytest.mark.one_rank
def test_bodies_of_one_file_are_meshed_together(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rf.read_scene(DEMOS / "dovetail.toml", ["mesh.contact_elements=8"])
    apart = [user_mesh.read_user_meshes([body], scene.mesh)[0] for body in scene.bodies]
    jobs: list[object] = []

    submit = workers.submit

    def counted(*job: Any) -> Any:
        jobs.append(job)
        return submit(*job)

    monkeypatch.setattr(workers, "submit", counted)
    for found, wanted in zip(raw_meshes(scene, False), apart, strict=True):
        np.testing.assert_equal(asdict(found), asdict(wanted))
    assert len(jobs) == 1
