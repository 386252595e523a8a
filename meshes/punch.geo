// A large half-disc, or the quarter of it with x >= 0, that is pressed against a flat punch on |x| < 1 of its straight
// side y = 0. Groups: "punch", "free" beside it, "far" (the arc), for the quarter also "axis" (x = 0).
//
// Triangles have the size 1 / (half the contact elements) on the punch and grow with the distance from it.

DefineConstant[
  radius = {20, Min 2, Name "Body/1radius over the punch's half width"},
  quarter = {0, Choices{0, 1}, Name "Body/2only x >= 0"},
  contact_elements = {80, Min 4, Step 2, Name "Mesh/1elements on |x| < 1"},
  growth = {1.15, Min 1.01, Max 3, Step 0.05, Name "Mesh/2growth between layers"}
];

dx = 2 / contact_elements;

Point(1) = {0, 0, 0};
Point(2) = {1, 0, 0};
Point(3) = {radius, 0, 0};
Point(4) = {0, radius, 0};
Line(2) = {2, 3};
Circle(3) = {3, 1, 4};
If (quarter)
  Line(1) = {1, 2};
  Line(4) = {4, 1};
  Curve Loop(1) = {1, 2, 3, 4};
  Transfinite Curve{1} = contact_elements / 2 + 1;
  Physical Curve("free") = {2};
  Physical Curve("far") = {3};
  Physical Curve("axis") = {4};
Else
  Point(5) = {-1, 0, 0};
  Point(6) = {-radius, 0, 0};
  Line(1) = {5, 2};
  Circle(4) = {4, 1, 6};
  Line(5) = {6, 5};
  Curve Loop(1) = {1, 2, 3, 4, 5};
  Transfinite Curve{1} = contact_elements + 1;
  Physical Curve("free") = {2, 5};
  Physical Curve("far") = {3, 4};
EndIf
Plane Surface(1) = {1};
Physical Curve("punch") = {1};
Physical Surface("body") = {1};

// distance from the punch |x| < 1, y = 0
Field[1] = MathEval;
Field[1].F = Sprintf("%.17g + %.17g * sqrt((0.5 * (abs(x) - 1 + abs(abs(x) - 1)))^2 + y^2)", dx, growth - 1);
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.Algorithm = 6;
