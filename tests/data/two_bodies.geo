// Two plates that share the interface line; quadrilaterals when recombined.
h = 2e-3;
Point(1) = {0, -10e-3, 0, h}; Point(2) = {40e-3, -10e-3, 0, h}; Point(3) = {40e-3, 0, 0, h}; Point(4) = {0, 0, 0, h};
Point(5) = {40e-3, 10e-3, 0, h}; Point(6) = {0, 10e-3, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Line(5) = {3, 5}; Line(6) = {5, 6}; Line(7) = {6, 4};
Curve Loop(1) = {1, 2, 3, 4}; Curve Loop(2) = {-3, 5, 6, 7};
Plane Surface(1) = {1}; Plane Surface(2) = {2};
Physical Surface("lower") = {1}; Physical Surface("upper") = {2};
Physical Curve("main") = {3};
Physical Curve("upper.left") = {7}; Physical Curve("upper.top") = {6}; Physical Curve("lower.bottom") = {1};
