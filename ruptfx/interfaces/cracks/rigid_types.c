// Types of rigid.c and of the formulas of laws in front of it. rigid.py writes in front of this file where states are, and
// how many corners and ends a vertex has at most.
#include <string.h>

#define OLD(name) state[STATE_##name][l]

enum { STATES };  // STATE_normal_traction = 0, ...
enum { FACETS };  // FACET_time_of_yield = 0, ...

struct law {
    double (*left)(const double *number, double damage);
    double (*damage)(const double *number, double opening, double slip);
    double (*friction)(const double *number, double *const *state, long l, double normal_stress);
    void (*advance)(const double *number, double *const *state, long l, double slip_rate, double normal_stress,
                    double since);
};

// Arrays of a run, which rigid.py explains; leader, split, inserted and left change during it.
struct rigid {
    long cells, facets;
    const int *star_start, *star, *ends_start, *ends, *place, *corner, *cell, *group, *first_number, *dof, *body;
    int *leader, *split, *inserted, *left;
    const double *normal, *weight, *owned, *number, *strength, *gradient, *stiffness, *mass;
    const double *initial;  // uniform initial stress xx, yy, xy, where PRELOADED
    const double *along;    // length of facets, with the sign of its sense along the tangent
    double *stress, *present;  // of cells; normals at the beginning of the step, those of the mesh without large rotations
};
