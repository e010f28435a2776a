__all__ = [
    "DONE",
    "EACH",
    "EXTRA",
    "FOLDER",
    "SHARED",
    "TABLE",
    "Entry",
    "Estimate",
    "Group",
    "Grouping",
    "Job",
    "Leftover",
    "Options",
    "Outcome",
    "Place",
    "Row",
    "SharedScene",
    "angles_in_names",
    "as_seen_from",
    "check_parquet",
    "combine_scenes",
    "distinct",
    "done",
    "group_sources",
    "local_cluster",
    "place_for",
    "read_table",
    "run_batch",
    "separate_files",
    "separate_many",
    "shared_scene_of",
]

from .cluster import EXTRA as EXTRA
from .cluster import Place as Place
from .cluster import done as done
from .cluster import local_cluster as local_cluster
from .cluster import place_for as place_for
from .group import EACH as EACH
from .group import FOLDER as FOLDER
from .group import Group as Group
from .group import Grouping as Grouping
from .group import Leftover as Leftover
from .group import angles_in_names as angles_in_names
from .group import distinct as distinct
from .group import group_sources as group_sources
from .job import DONE as DONE
from .job import Job as Job
from .job import Options as Options
from .job import Row as Row
from .job import separate_files as separate_files
from .many import SHARED as SHARED
from .many import separate_many as separate_many
from .many import shared_scene_of as shared_scene_of
from .run import Outcome as Outcome
from .run import run_batch as run_batch
from .shared_scene import Estimate as Estimate
from .shared_scene import SharedScene as SharedScene
from .shared_scene import as_seen_from as as_seen_from
from .shared_scene import combine_scenes as combine_scenes
from .summary import check_parquet as check_parquet
from .table import TABLE as TABLE
from .table import Entry as Entry
from .table import read_table as read_table
