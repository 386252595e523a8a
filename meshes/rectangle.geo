// The half x >= 0 of a rectangle that is symmetric about x = 0; "bottom" (y = 0) is the contact edge.
// The whole body is this mesh and its mirror image.
//
// Triangles have the size dx + (growth - 1) d, d being the distance from the contact edge or from the nearest end of
// a load or support, so that neighbouring layers differ by about the factor growth; quadrilaterals lie in columns of
// width dx and in layers whose height follows the same rule, d being measured along y.

DefineConstant[
  width = {4, Min 1e-3, Name "Body/1width (whole)"},
  height = {1, Min 1e-3, Name "Body/2height"},
  contact_elements = {160, Min 2, Step 2, Name "Mesh/1elements on the contact edge (whole)"},
  growth = {1.25, Min 1, Max 3, Step 0.05, Name "Mesh/2growth between layers"},
  quadrilaterals = {0, Choices{0, 1}, Name "Mesh/3quadrilaterals"},
  both_edges = {0, Choices{0, 1}, Name "Mesh/4the top edge has the vertices of the bottom edge"}
];

// Where vertices have to lie besides the corners: x on the top edge, y on the right edge, points inside.
If (!Exists(top_marks))
  top_marks() = {height};
EndIf
If (!Exists(side_marks))
  side_marks() = {};
EndIf
If (!Exists(inner_x))
  inner_x() = {};
  inner_y() = {};
EndIf
// ends of loads and supports above the contact edge
If (!Exists(end_x))
  end_x() = {height};
  end_y() = {height};
EndIf

dx = width / contact_elements;
half = 0.5 * width;

// heights of vertices on the sides, each with its distance from the contact edge or the nearest end; quadrilaterals
// also get the heights in between where that distance is largest
marks() = {side_marks(), height};
levels() = {0};
distances() = {0};
For i In {0 : #marks() - 1}
  here = marks(i);
  distance = here;
  For j In {0 : #end_y() - 1}
    distance = Min(distance, Fabs(here - end_y(j)));
  EndFor
  below = levels(#levels() - 1);
  furthest = 0.5 * (here - below + distance + distances(#distances() - 1));
  between = here + distance - furthest;
  If (quadrilaterals && growth > 1 && between - below > dx && here - between > dx)
    levels() += {between};
    distances() += {furthest};
  EndIf
  levels() += {here};
  distances() += {distance};
EndFor

// corners and marks, each list ordered upwards or rightwards
axis_points() = {newp}; Point(axis_points(0)) = {0, 0, 0};
right_points() = {newp}; Point(right_points(0)) = {half, 0, 0};
For i In {1 : #levels() - 1}
  p = newp; Point(p) = {half, levels(i), 0}; right_points() += {p};
  If (quadrilaterals && i < #levels() - 1)
    p = newp; Point(p) = {0, levels(i), 0}; axis_points() += {p};
  EndIf
EndFor
// points inside that lie on the axis split it
For i In {0 : #inner_x() - 1}
  If (inner_x(i) == 0)
    p = newp; Point(p) = {0, inner_y(i), 0}; axis_points() += {p};
  EndIf
EndFor
top_points() = {newp}; Point(top_points(0)) = {0, height, 0};
axis_points() += {top_points(0)};
stations() = {0};
For i In {0 : #top_marks() - 1}
  p = newp; Point(p) = {top_marks(i), height, 0}; top_points() += {p};
  stations() += {top_marks(i)};
EndFor
top_points() += {right_points(#right_points() - 1)};
stations() += {half};

// edges, split at the marks
bottom() = {newl}; Line(bottom(0)) = {axis_points(0), right_points(0)};
Transfinite Curve{bottom(0)} = Round(half / dx) + 1;
right() = {};
For i In {0 : #right_points() - 2}
  l = newl; Line(l) = {right_points(i), right_points(i + 1)}; right() += {l};
EndFor
axis() = {};
For i In {0 : #axis_points() - 2}
  l = newl; Line(l) = {axis_points(i), axis_points(i + 1)}; axis() += {l};
EndFor
top() = {};
For i In {0 : #top_points() - 2}
  l = newl; Line(l) = {top_points(i), top_points(i + 1)}; top() += {l};
EndFor

boundary() = {bottom(0), right()};
For i In {#top() - 1 : 0 : -1}
  boundary() += {-top(i)};
EndFor
For i In {#axis() - 1 : 0 : -1}
  boundary() += {-axis(i)};
EndFor
loop = newll; Curve Loop(loop) = {boundary()};
body = news; Plane Surface(body) = {loop};

If (quadrilaterals)
  For i In {0 : #top() - 1}
    Transfinite Curve{top(i)} = Round((stations(i + 1) - stations(i)) / dx) + 1;
  EndFor
  For i In {0 : #right() - 1}
    first = dx + (growth - 1) * distances(i);
    last = dx + (growth - 1) * distances(i + 1);
    If (growth > 1)
      layers = Round(Fabs(Log(last / first)) / Log(growth));
    Else
      layers = Round((levels(i + 1) - levels(i)) / dx);
    EndIf
    If (layers < 1)
      layers = 1;
    EndIf
    ratio = (last / first)^(1 / layers);
    Transfinite Curve{right(i), axis(i)} = layers + 1 Using Progression ratio;
  EndFor
  Transfinite Surface{body} = {axis_points(0), right_points(0), right_points(#right_points() - 1), top_points(0)};
  Recombine Surface{body};
Else
  For i In {0 : #inner_x() - 1}
    If (inner_x(i) > 0)
      p = newp; Point(p) = {inner_x(i), inner_y(i), 0};
      Point{p} In Surface{body};
    EndIf
  EndFor
  Field[1] = MathEval;
  Field[1].F = Sprintf("%.17g + %.17g * y", dx, growth - 1);
  fields() = {1};
  For i In {0 : #end_x() - 1}
    Field[i + 2] = MathEval;
    Field[i + 2].F = Sprintf("%.17g + %.17g * sqrt((x - %.17g)^2 + (y - %.17g)^2)", dx, growth - 1, end_x(i), end_y(i));
    fields() += {i + 2};
  EndFor
  If (both_edges)
    Transfinite Curve{top(0)} = Round(half / dx) + 1;
    Field[#fields() + 1] = MathEval;
    Field[#fields() + 1].F = Sprintf("%.17g + %.17g * (%.17g - y)", dx, growth - 1, height);
    fields() += {#fields() + 1};
  EndIf
  finest = #fields() + 1;
  Field[finest] = Min;
  Field[finest].FieldsList = {fields()};
  Background Field = finest;
EndIf

Physical Curve("bottom", 1) = {bottom()};
Physical Curve("right", 2) = {right()};
Physical Curve("top", 3) = {top()};
Physical Curve("axis", 5) = {axis()};
Physical Surface("body", 1) = {body};

Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.MeshSizeFromCurvature = 0;
Mesh.Algorithm = 6;
Mesh.ElementOrder = 1;
