// A coat below a core, which share the curve "seam".
Point(1) = {0, 0, 0, 0.5}; Point(2) = {4, 0, 0, 0.5}; Point(3) = {4, 1, 0, 0.5};
Point(4) = {0, 1, 0, 0.5}; Point(5) = {4, 2, 0, 0.5}; Point(6) = {0, 2, 0, 0.5};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Line(5) = {3, 5}; Line(6) = {5, 6}; Line(7) = {6, 4};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Curve Loop(2) = {-3, 5, 6, 7}; Plane Surface(2) = {2};
Physical Surface("coat") = {1}; Physical Surface("core") = {2};
Physical Curve("foot") = {1}; Physical Curve("top") = {6}; Physical Curve("seam") = {3};
Physical Curve("end") = {2, 5}; Physical Curve("wall") = {4, 7};
