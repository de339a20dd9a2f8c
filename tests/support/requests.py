"""An example of every request that the Jackal accepts."""

from executive import commands

GOOD: tuple[commands.Request, ...] = (
    commands.MoveTo(commands.Waypoint(1.0, 2.0, 0.5, 0.1)),
    commands.MoveForward(-1.0),
    commands.RotateTo(1.0),
    commands.RotateBy(-1.0),
    commands.DriveFor(0.5, 0.5, 2.0),
    commands.FollowPath((commands.Waypoint(1.0, 0.0), commands.Waypoint(2.0, 0.0))),
    commands.Stop(),
    commands.Resume(),
    commands.SetTravelSpeed(0.5),
    commands.SetRotateSpeed(0.5),
    commands.SetPositionCompensation(0.1, 0.1, 0.0, 0.1),
    commands.ConfirmPose(0.1, 0.05),
    commands.SetCameraAngles(0.5, None),
    commands.MoveCameraAngles(0.5, 0.1),
    commands.SetCameraRotateSpeed(0.5),
    commands.TakePicture(),
    commands.SetStatusInterval(0.0),
    commands.DeleteFile("pictures/MOE-1.jpg"),
    commands.MoveFile("pictures/MOE-1.jpg", "kept/rock.jpg"),
    commands.ExecuteAction("VIDEO ON"),
    commands.SubmitPlan(commands.PlanDefinition("survey", "A survey", "BTCPP4", b"<root/>")),
    commands.ActivatePlan("survey"),
    commands.SuspendPlan("survey"),
    commands.ResumePlan("survey"),
    commands.AbortPlan("survey"),
    commands.RemovePlan("survey"),
)
