"""Sessions on disk: MCAP with protobuf schemas, written, read and replayed."""

if __name__ != "viewsep.recordings":
    raise ImportError("this package is viewsep.recordings; import it by that name")
