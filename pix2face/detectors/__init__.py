"""What finds faces in a picture, each calibrated to ``FaceBox``: one file a detector."""
