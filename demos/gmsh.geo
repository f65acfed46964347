// A block with an inclined fault; names of physical groups are what a case refers to.
h = 4e-3;
Point(1) = {0, 0, 0, h};         Point(2) = {80e-3, 0, 0, h};
Point(3) = {80e-3, 25e-3, 0, h}; Point(4) = {0, 15e-3, 0, h};  // the fault runs from 4 to 3
Point(5) = {80e-3, 40e-3, 0, h}; Point(6) = {0, 40e-3, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Line(5) = {3, 5}; Line(6) = {5, 6}; Line(7) = {6, 4};
Curve Loop(1) = {1, 2, 3, 4};  Plane Surface(1) = {1};
Curve Loop(2) = {-3, 5, 6, 7}; Plane Surface(2) = {2};
Physical Surface("below") = {1}; Physical Surface("above") = {2};
Physical Curve("fault") = {3};
Physical Curve("above.left") = {7};
Recombine Surface {1, 2};
