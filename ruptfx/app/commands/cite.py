"""`ruptfx cite`."""

from __future__ import annotations

from ruptfx import __version__
from ruptfx.app.commands._shared import screen

HEADING = "Verify and extend"

BIBTEX = f"""@software{{ruptfx,
  title = {{ruptfx: frictional contact and rupture on FEniCSx}},
  author = {{{{The ruptfx developers}}}},
  version = {{{__version__}}},
  license = {{MIT}},
}}
@article{{coker2005,
  title = {{Frictional sliding modes along an interface between identical elastic plates subject to shear impact
           loading}},
  author = {{Coker, D. and Lykotrafitis, G. and Needleman, A. and Rosakis, A. J.}},
  journal = {{Journal of the Mechanics and Physics of Solids}},
  volume = {{53}}, number = {{4}}, pages = {{884--922}}, year = {{2005}},
}}
@article{{dolfinx2023,
  title = {{DOLFINx: the next generation FEniCS problem solving environment}},
  author = {{Baratta, I. A. and Dean, J. P. and Dokken, J. S. and Habera, M. and Hale, J. S. and Richardson, C. N. and
            Rognes, M. E. and Scroggs, M. W. and Sime, N. and Wells, G. N.}},
  doi = {{10.5281/zenodo.10447666}}, year = {{2023}},
}}"""


def cite() -> None:
    """Print BibTeX entries for ruptfx and the software it is built on.

    Example: ruptfx cite
    """
    screen.print(BIBTEX, markup=False, highlight=False, soft_wrap=True)
