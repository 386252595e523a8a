// Shaft in a hub, upper half of the section (x is the radius): their fit is a cylinder or, with taper = tan(angle), a cone that widens upwards.
DefineConstant[
  contact_elements = 40
  radius = 20      // of the shaft where the fit begins
  outer = 40       // radius of the hub
  length = 40      // of the fit
  overhang = 20    // of the shaft at both ends
  taper = 0
];
h = length / contact_elements;
top = radius + taper * length;
Point(3) = {radius, 0, 0, h}; Point(4) = {top, length, 0, h};
Point(7) = {outer, 0, 0, 8 * h}; Point(8) = {outer, length, 0, 8 * h};
Point(1) = {0, -overhang, 0, 8 * h}; Point(6) = {0, length + overhang, 0, 8 * h};
Line(3) = {3, 4}; Line(6) = {6, 1}; Line(7) = {3, 7}; Line(8) = {7, 8}; Line(9) = {8, 4};
If (overhang > 0)
  Point(2) = {radius, -overhang, 0, 4 * h}; Point(5) = {top, length + overhang, 0, 4 * h};
  Line(1) = {1, 2}; Line(2) = {2, 3}; Line(4) = {4, 5}; Line(5) = {5, 6};
  Curve Loop(1) = {1, 2, 3, 4, 5, 6};
Else
  Line(1) = {1, 3}; Line(5) = {4, 6};
  Curve Loop(1) = {1, 3, 5, 6};
EndIf
Plane Surface(1) = {1};
Curve Loop(2) = {7, 8, 9, -3}; Plane Surface(2) = {2};
Transfinite Curve {3} = contact_elements + 1;
Physical Surface("shaft") = {1}; Physical Surface("hub") = {2};
Physical Curve("fit") = {3}; Physical Curve("low") = {1}; Physical Curve("high") = {5};
Physical Curve("bed") = {7}; Physical Curve("cap") = {9};
