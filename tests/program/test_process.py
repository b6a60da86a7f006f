"""Values of a process."""

import pickle

from armcontour.program import Process


def test_a_process_goes_to_other_processes() -> None:
    process = Process(overlap=2e-3, by_layer={"cut": {"overlap": 1e-3}})
    again = pickle.loads(pickle.dumps(process))
    assert again.overlap == 2e-3 and again.of_layer("cut").overlap == 1e-3
    assert dict(again.by_layer) == dict(process.by_layer)
