// A pin of radius 1 and a lug with a hole of its size. The pin has more elements on the rim than the hole.
DefineConstant[ contact_elements = 160 ];
n = contact_elements / 4;
Point(1) = {0, 0, 0, 0.2};
For k In {0:3}
  Point(10 + k) = {Cos(k * Pi / 2), Sin(k * Pi / 2), 0, 0.2};
  Point(20 + k) = {Cos(k * Pi / 2), Sin(k * Pi / 2), 0, 0.2};
EndFor
For k In {0:3}
  Circle(10 + k) = {10 + k, 1, 10 + (k + 1) % 4};
  Circle(20 + k) = {20 + k, 1, 20 + (k + 1) % 4};
EndFor
Point(31) = {-3, -3, 0, 0.8}; Point(32) = {3, -3, 0, 0.8};
Point(33) = {3, 6, 0, 0.8}; Point(34) = {-3, 6, 0, 0.8};
Line(31) = {31, 32}; Line(32) = {32, 33}; Line(33) = {33, 34}; Line(34) = {34, 31};
Curve Loop(1) = {10:13}; Plane Surface(1) = {1};
Curve Loop(2) = {31:34}; Curve Loop(3) = {20:23}; Plane Surface(2) = {2, 3};
Transfinite Curve{10:13} = n + 1; Transfinite Curve{20:23} = 3 * n / 4 + 1;
Physical Surface("pin") = {1}; Physical Surface("lug") = {2};
Physical Curve("rim") = {10:13}; Physical Curve("hole") = {20:23}; Physical Curve("top") = {33};
