"""The requests of the catalogue (`MoveTo`, `Stop`, ...) and their declarations.

The modules `intake`, `lifecycle` and `actions` need the settings: they are not exported here but
imported by their own names.
"""

# All of the catalogue, so that a request is listed there alone.
from executive.commands.catalogue import *  # noqa: F403
from executive.commands.declaration import ACCEPTED as ACCEPTED
from executive.commands.declaration import RELAYED as RELAYED
from executive.commands.declaration import Argument as Argument
from executive.commands.declaration import AssetChoice as AssetChoice
from executive.commands.declaration import CommandDeclaration as CommandDeclaration
from executive.commands.declaration import Family as Family
from executive.commands.declaration import FilePath as FilePath
from executive.commands.declaration import Limit as Limit
from executive.commands.declaration import Mode as Mode
from executive.commands.declaration import SymmetricRange as SymmetricRange
from executive.commands.declaration import ValueRange as ValueRange
from executive.commands.declaration import all_declarations as all_declarations
from executive.commands.declaration import argument as argument
from executive.commands.declaration import arguments_of as arguments_of
from executive.commands.declaration import bounded as bounded
from executive.commands.declaration import declaration_of as declaration_of
from executive.commands.declaration import record as record
from executive.commands.formatting import argument_values as argument_values
from executive.commands.formatting import request_text as request_text
from executive.commands.precondition import OnlyAt as OnlyAt
from executive.commands.precondition import Precondition as Precondition
from executive.commands.segments import Arc as Arc
from executive.commands.segments import Curve as Curve
from executive.commands.segments import Line as Line
from executive.commands.segments import Reference as Reference
from executive.commands.segments import Rest as Rest
from executive.commands.segments import Segment as Segment
from executive.commands.segments import Turn as Turn
from executive.commands.segments import curves_of as curves_of
