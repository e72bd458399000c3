"""Images, models and photographs, in and out."""

from typing import TYPE_CHECKING

from milkglass.core.lazy import lazy

if TYPE_CHECKING:
    from milkglass.viewer.files.formats import PICTURE_FORMATS as PICTURE_FORMATS
    from milkglass.viewer.files.formats import PictureContents as PictureContents
    from milkglass.viewer.files.formats import write_picture as write_picture
    from milkglass.viewer.files.images import read_image as read_image
    from milkglass.viewer.files.images import read_radiance as read_radiance
    from milkglass.viewer.files.model import FileModel as FileModel
    from milkglass.viewer.files.model import load_model as load_model
    from milkglass.viewer.files.model import read_model as read_model
    from milkglass.viewer.files.photograph import Photo as Photo
    from milkglass.viewer.files.photograph import load_photo as load_photo
else:
    __getattr__, __dir__, __all__ = lazy(__name__)
