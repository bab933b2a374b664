from .decision import Decision as Decision
from .decision import Plan as Plan
from .plan import plan as plan
