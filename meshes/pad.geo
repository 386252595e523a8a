// A large block |x| < size, 0 < y < size (or -size < y < 0), with a fine straight side on |x| < half_width.
// Groups: "contact" (|x| < half_width), "free" beside it and at the sides, "platen" (y = size).
//
// Triangles have the size of a contact element on the contact and grow with the distance from it.

DefineConstant[
  size = {20, Min 1e-3, Name "Body/1half width and height"},
  half_width = {1, Min 1e-3, Name "Body/2half width of the contact side"},
  up = {1, Choices{-1, 1}, Name "Body/3above (1) or below (-1) the contact"},
  contact_elements = {80, Min 2, Name "Mesh/1elements on the contact side"},
  growth = {1.15, Min 1.01, Max 3, Step 0.05, Name "Mesh/2growth between layers"}
];

dx = 2 * half_width / contact_elements;

Point(1) = {-size, 0, 0};
Point(2) = {-half_width, 0, 0};
Point(3) = {half_width, 0, 0};
Point(4) = {size, 0, 0};
Point(5) = {size, up * size, 0};
Point(6) = {-size, up * size, 0};
For i In {1 : 6}
  Line(i) = {i, i % 6 + 1};
EndFor
Curve Loop(1) = {1 : 6};
Plane Surface(1) = {1};
Transfinite Curve{2} = contact_elements + 1;
Physical Curve("contact") = {2};
Physical Curve("free") = {1, 3, 4, 6};
Physical Curve("platen") = {5};
Physical Surface("body") = {1};

// distance from the contact side
Field[1] = MathEval;
Field[1].F = Sprintf("%.17g + %.17g * sqrt((0.5 * (abs(x) - %.17g + abs(abs(x) - %.17g)))^2 + y^2)", dx, growth - 1, half_width, half_width);
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.Algorithm = 6;
