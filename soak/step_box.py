"""A STEP file of a box, written without a CAD kernel."""

from __future__ import annotations

from itertools import product

import numpy as np

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('box','2020-01-01T00:00:00',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
"""
CONTEXT = """#1=APPLICATION_CONTEXT('automotive design');
#2=PRODUCT_CONTEXT('',#1,'mechanical');
#3=PRODUCT('box','box','',(#2));
#4=PRODUCT_DEFINITION_FORMATION('','',#3);
#5=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#6=PRODUCT_DEFINITION('design','',#4,#5);
#7=PRODUCT_DEFINITION_SHAPE('','',#6);
#8=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#9=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#10=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#11=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),#8,'distance_accuracy_value','');
#12=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#11))
GLOBAL_UNIT_ASSIGNED_CONTEXT((#8,#9,#10))REPRESENTATION_CONTEXT('',''));
"""
TAIL = "ENDSEC;\nEND-ISO-10303-21;\n"


class _Entities:
    """Entities of a file, numbered in the order in which they are added."""

    def __init__(self, first: int) -> None:
        self.number = first
        self.lines: list[str] = []

    def add(self, text: str) -> str:
        """Add an entity, and return its name."""
        self.number += 1
        self.lines.append(f"#{self.number}={text};\n")
        return f"#{self.number}"

    def vector(self, kind: str, values: np.ndarray) -> str:
        """Add a point or a direction."""
        return self.add(f"{kind}('',({','.join(f'{x:.6f}' for x in values)}))")


def step_box(size: tuple[float, float, float]) -> str:
    """Return a STEP file with a box from the origin, of a size in mm."""
    entities = _Entities(first=12)
    corners = [np.array(x) * size for x in product((0, 1), repeat=3)]
    points = [entities.vector("CARTESIAN_POINT", x) for x in corners]
    vertices = [entities.add(f"VERTEX_POINT('',{x})") for x in points]
    edges: dict[tuple[int, int], str] = {}
    faces = []
    for axis, side in product(range(3), (0, 1)):
        # Corners of the face, counter-clockwise seen from outside.
        loop = [0, 1, 3, 2] if side else [0, 2, 3, 1]
        others = [(axis + 1) % 3, (axis + 2) % 3]
        numbers = []
        for k in loop:
            bits = np.zeros(3, dtype=int)
            bits[axis] = side
            bits[others] = k & 1, k >> 1
            numbers.append(int(bits @ [4, 2, 1]))
        uses = []
        for a, b in zip(numbers, [*numbers[1:], numbers[0]], strict=True):
            low, high = min(a, b), max(a, b)
            if (low, high) not in edges:
                along = corners[high] - corners[low]
                direction = entities.vector("DIRECTION", along / np.linalg.norm(along))
                vector = entities.add(f"VECTOR('',{direction},1.)")
                line = entities.add(f"LINE('',{points[low]},{vector})")
                ends = f"{vertices[low]},{vertices[high]}"
                edges[low, high] = entities.add(f"EDGE_CURVE('',{ends},{line},.T.)")
            forward = "T" if a < b else "F"
            uses.append(entities.add(f"ORIENTED_EDGE('',*,*,{edges[low, high]},.{forward}.)"))
        bound = entities.add(f"EDGE_LOOP('',({','.join(uses)}))")
        outer = entities.add(f"FACE_OUTER_BOUND('',{bound},.T.)")
        normal = entities.vector("DIRECTION", np.eye(3)[axis] * (2 * side - 1))
        across = entities.vector("DIRECTION", np.eye(3)[others[0]])
        place = entities.add(f"AXIS2_PLACEMENT_3D('',{points[numbers[0]]},{normal},{across})")
        plane = entities.add(f"PLANE('',{place})")
        faces.append(entities.add(f"ADVANCED_FACE('',({outer}),{plane},.T.)"))
    shell = entities.add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = entities.add(f"MANIFOLD_SOLID_BREP('box',{shell})")
    shape = entities.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('box',({solid}),#12)")
    entities.add(f"SHAPE_DEFINITION_REPRESENTATION(#7,{shape})")
    return HEAD + CONTEXT + "".join(entities.lines) + TAIL
