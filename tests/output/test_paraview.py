import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from mpi4py import MPI

import h5py
import numpy as np
import pytest

from receding_fenicsx import environment
from receding_fenicsx.bulk.fields import solve_fields
from receding_fenicsx.bulk.stress import STRESSES
from receding_fenicsx.output.snapshots.paraview import (
    join_fields,
    join_instants,
    time_of,
    write_fields,
)
from receding_fenicsx.pictures import picture_body
from receding_fenicsx.scene.toml_file import read_scene

BLOCK = Path(__file__).parents[2] / "demos" / "block.toml"
COMM = MPI.COMM_WORLD
READ = """
import sys
from vtkmodules.vtkIOXdmf2 import vtkXdmfReader
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
reader = vtkXdmfReader()
reader.SetFileName(sys.argv[1])
reader.UpdateInformation()
times = reader.GetOutputInformation(0).Get(Pipeline.TIME_STEPS())
for time in times:
    reader.UpdateTimeStep(time)
    grid = reader.GetOutputDataObject(0)
    moved = grid.GetPointData().GetArray("displacement")
    cells = grid.GetCellData()
    names = [cells.GetArrayName(i) for i in range(cells.GetNumberOfArrays())]
    print(time, grid.GetNumberOfPoints(), round(moved.GetRange(1)[0], 6), *sorted(names))
"""
"""Prints, for each time, number of points, lowest vertical displacement and the cells' fields."""


@pytest.fixture
def folder(shared_tmp_path: Path) -> Path:
    """Three instants of a small block, the loads 1, 2 and 3, written out of order."""
    scene = read_scene(BLOCK, ["mesh.contact_elements=8", "mesh.degree=1"])
    bulk = picture_body(scene, COMM)
    n = len(bulk.contact.x)
    for cycle, leg, load in ((1, 1, 3.0), (0, 0, 1.0), (1, 0, 2.0)):
        file = shared_tmp_path / f"cycle{cycle:04d}_leg{leg}_s1.000.xdmf"
        write_fields(solve_fields(bulk, np.array([load]), np.zeros(2 * n)), file)
        COMM.Barrier()
        if COMM.rank == 0:
            join_fields(file, time_of(cycle, leg, 1.0, 1 + cycle))
            join_instants(shared_tmp_path)
        COMM.Barrier()
    bulk.destroy()
    return shared_tmp_path


def test_time_counts_cycles() -> None:
    assert time_of(0, 0, 0.5, 1) == 0.5
    assert [time_of(3, leg, s, 2) for leg, s in ((0, 0.0), (0, 1.0), (1, 1.0))] == [3.0, 3.5, 4.0]


def test_an_instant_is_one_grid_with_all_fields_and_a_time(folder: Path) -> None:
    grids = list(ET.parse(folder / "cycle0001_leg0_s1.000.xdmf").getroot().iter("Grid"))
    assert [grid.attrib["Name"] for grid in grids] == ["cycle0001_leg0_s1.000"]
    names = [attribute.attrib["Name"] for attribute in grids[0].iter("Attribute")]
    assert names == ["displacement", *STRESSES]
    # every array that it speaks of is there
    for item in grids[0].iter("DataItem"):
        name, _, place = (item.text or "").strip().partition(":")
        with h5py.File(folder / name) as file:
            shape = tuple(map(int, item.attrib["Dimensions"].split()))
            assert file[place].shape == shape
    COMM.Barrier()


def test_instants_are_a_series_in_time(folder: Path) -> None:
    series = ET.parse(folder / "instants.xdmf").getroot().find("Domain/Grid")
    assert series is not None and series.attrib["CollectionType"] == "Temporal"
    assert [time.attrib["Value"] for time in series.iter("Time")] == ["1.0", "1.5", "2.0"]
    COMM.Barrier()


@pytest.mark.skipif(COMM.size > 1, reason="one process is enough")
def test_vtk_s_reader_finds_fields_and_times(folder: Path) -> None:
    # in a process of its own: DOLFINx and VTK do not go well together
    done = subprocess.run(
        [sys.executable, "-c", READ, str(folder / "instants.xdmf")],
        env=environment.child_environment(),
        capture_output=True,
        text=True,
        timeout=300,
    )
    if "No module named" in done.stderr:
        pytest.skip("this VTK has no reader of XDMF")
    rows = [line.split() for line in done.stdout.splitlines()]
    assert [row[0] for row in rows] == ["1.0", "1.5", "2.0"], done.stderr
    assert all(row[3:] == sorted(STRESSES) for row in rows)
    lowest = np.array([float(row[2]) for row in rows])
    np.testing.assert_allclose(lowest, lowest[0] * np.array([1.0, 2.0, 3.0]), rtol=1e-4)
    assert lowest[0] < 0.0
