// The dovetail root of a blade in its slot of a disc, pulled upwards, of width 2 at the neck. The flanks lie on the lines
// |x| + y = 1; they touch on the pads between |x| = pad_begin and pad_end, elsewhere there is clearance.
// Surfaces: "blade", "disc". Groups: "left" and "right" (the pads, curves of both), "pull" (top of the blade), "bed".
//
// The pads are curves of both surfaces, so that their nodes match.

DefineConstant[
  pad_begin = {1.2, Min 1.05, Max 1.5, Name "Body/1beginning of the pads"},
  pad_end = {1.8, Min 1.55, Max 1.95, Name "Body/2end of the pads"},
  contact_elements = {40, Min 4, Step 2, Name "Mesh/1elements on each pad"},
  growth = {1.2, Min 1.01, Max 3, Step 0.05, Name "Mesh/2growth between layers"}
];

// the right half from the top of the blade round its root, then of the disc round its slot to the bed
blade_x() = {0, 1, 1, pad_begin, pad_end, 2, 2, 0};
blade_y() = {2.5, 2.5, 0, 1 - pad_begin, 1 - pad_end, -1, -1.5, -1.5};
disc_x() = {pad_begin, 1.4, 1.4, 6, 6, 0, 0, 2.2, 2.2};
disc_y() = {1 - pad_begin, 0.4, 0.8, 0.8, -4, -4, -1.8, -1.8, 1 - pad_end};

For side In {0 : 1}
  sign = 1 - 2 * side;
  // points on the axis are made once
  blade~{side}() = {};
  For i In {0 : #blade_x() - 1}
    If (side == 1 && blade_x(i) == 0)
      blade~{side}() += {blade~{0}(i)};
    Else
      p = newp; Point(p) = {sign * blade_x(i), blade_y(i), 0}; blade~{side}() += {p};
    EndIf
  EndFor
  disc~{side}() = {blade~{side}(3)};
  For i In {1 : #disc_x() - 1}
    If (side == 1 && disc_x(i) == 0)
      disc~{side}() += {disc~{0}(i)};
    Else
      p = newp; Point(p) = {sign * disc_x(i), disc_y(i), 0}; disc~{side}() += {p};
    EndIf
  EndFor
  disc~{side}() += {blade~{side}(4)};
  blade_lines~{side}() = {};
  For i In {0 : #blade~{side}() - 2}
    l = newl; Line(l) = {blade~{side}(i), blade~{side}(i + 1)}; blade_lines~{side}() += {l};
  EndFor
  disc_lines~{side}() = {};
  For i In {0 : #disc~{side}() - 2}
    // from the floor of the slot on the other half goes on
    If (i != 5)
      l = newl; Line(l) = {disc~{side}(i), disc~{side}(i + 1)}; disc_lines~{side}() += {l};
    EndIf
  EndFor
EndFor

// loops: down the right half and up the left one
loop() = {blade_lines_0()};
For i In {#blade_lines_1() - 1 : 0 : -1}
  loop() += {-blade_lines_1(i)};
EndFor
Curve Loop(1) = {loop()}; Plane Surface(1) = {1};

// the disc: its outside from the right pad to the bed's middle and back up the left side, then the slot
outside() = {};
For i In {0 : 4}
  outside() += {disc_lines_0(i)};
EndFor
For i In {4 : 0 : -1}
  outside() += {-disc_lines_1(i)};
EndFor
slot() = {blade_lines_1(3)};
For i In {#disc_lines_1() - 1 : 5 : -1}
  slot() += {-disc_lines_1(i)};
EndFor
For i In {5 : #disc_lines_0() - 1}
  slot() += {disc_lines_0(i)};
EndFor
slot() += {-blade_lines_0(3)};
Curve Loop(2) = {outside(), slot()}; Plane Surface(2) = {2};

Transfinite Curve{blade_lines_0(3), blade_lines_1(3)} = contact_elements + 1;
dx = Sqrt(2) * (pad_end - pad_begin) / contact_elements;
Field[1] = Distance;
Field[1].CurvesList = {blade_lines_0(3), blade_lines_1(3)};
Field[1].Sampling = 400;
Field[2] = MathEval;
Field[2].F = Sprintf("%.17g + %.17g * F1", dx, growth - 1);
Background Field = 2;

Physical Curve("right") = {blade_lines_0(3)};
Physical Curve("left") = {blade_lines_1(3)};
Physical Curve("pull") = {blade_lines_0(0), blade_lines_1(0)};
Physical Curve("bed") = {disc_lines_0(4), disc_lines_1(4)};
Physical Surface("blade") = {1};
Physical Surface("disc") = {2};

Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.Algorithm = 6;
Mesh.ElementOrder = 1;
