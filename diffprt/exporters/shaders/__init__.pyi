from .program import STAGES as STAGES
from .program import program_names as program_names
from .program import read_program as read_program
from .source import LANGUAGES as LANGUAGES
from .source import shader_source as shader_source
from .source import write_shaders as write_shaders
