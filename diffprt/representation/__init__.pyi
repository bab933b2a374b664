from .files import load as load
from .files import read_header as read_header
from .files import read_tensor as read_tensor
from .files import save as save
