DefineConstant[ width = {4, Name "width"}, contact_elements = 8 ]; height = 1;
Point(1) = {-width/2, 0, 0}; Point(2) = {width/2, 0, 0};
Point(3) = {width/2, height, 0}; Point(4) = {-width/2, height, 0};
For i In {1 : 4}
  Line(i) = {i, i % 4 + 1};
EndFor
Curve Loop(1) = {1 : 4}; 
Transfinite Curve{1, 3} = contact_elements + 1; Transfinite Curve{2, 4} = 5;
//{1};
Physical Curve("foot") = {1}; Physical Curve("top") = {3};
