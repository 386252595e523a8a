// A large half-disc y < 0 that stands for a half-plane, with a fine straight side on |x| < half_width.
// Groups: "contact" (|x| < half_width), "free" beside it, "far" (the arc); points "west", "south", "east" of the arc.
//
// Triangles have the size of a contact element on the contact and grow with the distance from it.

DefineConstant[
  radius = {20, Min 1e-3, Name "Body/1radius"},
  half_width = {1, Min 1e-3, Name "Body/2half width of the contact side"},
  contact_elements = {80, Min 2, Name "Mesh/1elements on the contact side"},
  growth = {1.15, Min 1.01, Max 3, Step 0.05, Name "Mesh/2growth between layers"}
];

dx = 2 * half_width / contact_elements;

Point(1) = {0, 0, 0};
Point(2) = {-radius, 0, 0};
Point(3) = {-half_width, 0, 0};
Point(4) = {half_width, 0, 0};
Point(5) = {radius, 0, 0};
Point(6) = {0, -radius, 0};
Line(1) = {2, 3};
Line(2) = {3, 4};
Line(3) = {4, 5};
Circle(4) = {5, 1, 6};
Circle(5) = {6, 1, 2};
Curve Loop(1) = {1, 2, 3, 4, 5};
Plane Surface(1) = {1};
Transfinite Curve{2} = contact_elements + 1;
Physical Curve("contact") = {2};
Physical Curve("free") = {1, 3};
Physical Curve("far") = {4, 5};
Physical Point("west") = {2};
Physical Point("east") = {5};
Physical Point("south") = {6};
Physical Surface("body") = {1};

// distance from the contact side
Field[1] = MathEval;
Field[1].F = Sprintf("%.17g + %.17g * sqrt((0.5 * (abs(x) - %.17g + abs(abs(x) - %.17g)))^2 + y^2)", dx, growth - 1, half_width, half_width);
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.Algorithm = 6;
