"""The node brain_model: the update and its questions, around case_update.py."""
import os
import threading
import time
from dataclasses import replace

import numpy as np
import rospy
from cortshift_msgs.msg import DisplacementField, MovedLabel, UpdatedMr
from cortshift_msgs.srv import ListStages, Locate, LocateResponse, UpdateModel, UpdateModelResponse
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point
from sensor_msgs.msg import Image, PointCloud2, PointField
from std_msgs.msg import Header

from cortshift_tracking.case.folder import SAME_STAMP, gravity_of, read_stage
from cortshift_tracking.case.messages import field_from_message
from cortshift_tracking.errors import CortshiftError
from cortshift_tracking.model.brain import ModelError, load_model
from cortshift_tracking.model.case_update import check_mr, direction_of, epochs_of, located, overlay_of, update_case, write_update
from cortshift_tracking.mr.admission import admit_mr, remembered_source
from cortshift_tracking.mr.marked import load_marked
from cortshift_tracking.parameters import ParameterError, read_parameters
from cortshift_tracking.probe.store import read_points

PARAMETERS = {
    'mr': '',                        # the MR that the model is of, where it is not where it was
    'resected': '',                  # volume in the MR's space, > 0 where tissue was taken out; it and its file are read at each update; '': none
    'output': '',                    # folder for the files of each update; '': brain_model in the case
    'gravity': [0.0, 0.0, 0.0],      # direction in pmr where the probe has not digitised it; zeros: not known
}

BORDER_FIELDS = ('x', 'y', 'z', 'dx', 'dy', 'dz')   # of a moved label's border
FIELD_ARRIVES = 3.0   # s: a field may be under way when its compute_shift has answered
# s: so may one that replaces an older field of the same pair, which nothing in the older one tells. shift_tracker publishes before it
# answers; the 10 MB of a field then take some 0.1 s by a network of 1 Gbit/s and through rospy.
FIELD_SETTLES = 1.0
BUFFER = 1 << 26      # bytes: rospy reads a large message whole only where it has room for it


def updated_mr_message(mr, structures, field):
    """cortshift_msgs/UpdatedMr of the updated MR (Volume) and its Structures, by a Field."""
    header = Header(stamp=rospy.Time.from_sec(field.to_stamp), frame_id='pmr')
    message = UpdatedMr(header=header, from_key=field.from_key, to_key=field.to_key, T_pmr_voxel=np.ravel(mr.T_pmr_voxel).tolist())
    columns, rows, _ = mr.data.shape
    for values in np.moveaxis(mr.data, 2, 0):
        message.slices.append(Image(header=header, height=rows, width=columns, encoding='32FC1', step=4 * columns,
                                    data=np.ascontiguousarray(values.T, '<f4').tobytes()))
    for structure in structures:   # one that was resected is empty, and takes the place of its border of before
        data = np.concatenate([structure.was, structure.now - structure.was], 1).astype('<f4')
        cloud = PointCloud2(header=header, height=1, width=len(data), point_step=4 * len(BORDER_FIELDS), row_step=4 * len(BORDER_FIELDS) * len(data),
                            data=data.tobytes(), is_dense=True)
        cloud.fields = [PointField(name, 4 * n, PointField.FLOAT32, 1) for n, name in enumerate(BORDER_FIELDS)]
        message.labels.append(MovedLabel(name=structure.name, border=cloud, quads=structure.quads.ravel().tolist()))
    return message


def _other_captures(field, stages):
    """Keys of a DisplacementField whose stage, in `stages` (key to StageInfo), was exposed at another time. The preoperative MR is none."""
    ends = ((field.from_key, field.from_stamp), (field.to_key, field.to_stamp))
    return [key for key, stamp in ends if key in stages and abs((stages[key].stamp - stamp).to_sec()) > SAME_STAMP]


class BrainModelNode:
    """Services ~update, ~locate; see the .srv files.

    Parameters   case (text, required): folder of the case; model (text, required): file of prepare_model; PARAMETERS above
    Subscribes   shift/field (the fields that ~update can take)
    Calls        shift_tracker/list_stages (the exposures and epochs of the field's stages)
    Publishes    ~overlay (the rectified left image of the later stage with the structures as they were and are, latched),
                 ~updated_mr (for igtl_bridge, latched), /diagnostics
    """

    def __init__(self):
        self._values = read_parameters(PARAMETERS, required=('case', 'model'))
        self._model = load_model(self._values['model'])
        self._source = remembered_source(self._model.provenance, self._values['mr'], 'parameter mr')
        self._volume = admit_mr(self._source, [])
        check_mr(self._model, self._volume)
        self._lock, self._fields, self._updated, self._refused = threading.Lock(), {}, None, False
        self._arrived = threading.Condition()
        self._state = 'no update yet'
        rospy.Subscriber('shift/field', DisplacementField, self._keep, queue_size=5, buff_size=BUFFER)
        self._diagnostics = rospy.Publisher('/diagnostics', DiagnosticArray, queue_size=5)
        self._overlays = rospy.Publisher('~overlay', Image, queue_size=1, latch=True)
        self._updates = rospy.Publisher('~updated_mr', UpdatedMr, queue_size=1, latch=True)
        rospy.Service('~update', UpdateModel, self._update)
        rospy.Service('~locate', Locate, self._locate)
        threading.Thread(target=self._report, daemon=True).start()

    def _keep(self, message):
        if message.to_key:   # those of the live mode belong to no stage
            with self._arrived:
                self._fields[message.from_key, message.to_key] = message
                self._arrived.notify_all()

    def _field(self, request, stages):
        """The newest field of a request between these stages, which may just be on its way. stages: key to StageInfo. Raises ModelError."""
        keys = request.from_key, request.to_key
        with self._arrived:
            before = self._fields.get(keys)
            patience = FIELD_ARRIVES if before is None or _other_captures(before, stages) else FIELD_SETTLES
            self._arrived.wait_for(lambda: self._fields.get(keys) is not before and not _other_captures(self._fields[keys], stages), patience)
            if keys not in self._fields:
                there = ', '.join(f'{a} -> {b}' for a, b in self._fields) or 'none'
                raise ModelError(f'no field {keys[0]} -> {keys[1]} was published; compute it with shift_tracker/compute_shift. There are: {there}')
            other = _other_captures(self._fields[keys], stages)
            if other:
                raise ModelError(f'the field {keys[0]} -> {keys[1]} is of another capture of "{other[0]}"; compute it again')
            return self._fields[keys]

    def _update(self, request):
        began = time.monotonic()
        name = f'{request.from_key} -> {request.to_key}'
        try:
            with self._lock:
                stages = self._stages(request)
                field = field_from_message(self._field(request, stages))
                updated = update_case(self._model, self._volume, field, self._gravity(), self._model.labels, self._resected(),
                                      epochs_of(field, stages.values()))
                folder = self._values['output'] or os.path.join(self._values['case'], 'brain_model')
                folder = os.path.join(folder, f'{request.from_key}__{request.to_key}')
                image, picture, why = self._overlay(updated, field)
                message = updated_mr_message(updated.mr, updated.structures, field)
                write_update(updated, folder, picture)
                self._updated, self._refused = updated, False
                if image is not None:
                    self._overlays.publish(image)
                self._updates.publish(message)
        except (CortshiftError, OSError) as error:
            return self._not_updated(name, error, began)
        except MemoryError:
            return self._not_updated(name, 'not enough memory; close other programs, or prepare a model of fewer elements', began)
        except Exception as error:   # of whatever library: the caller and the diagnostics hear of it  # pylint: disable=broad-except
            return self._not_updated(name, f'the update could not be computed ({error!r}); compute the field again, and report the case', began)
        warnings = ''.join(f'; warning: {text}' for text in updated.summary['warnings'])
        self._state = f'{name} updated, largest displacement {updated.summary["largest_displacement_mm"]:.1f} mm, files in {folder}{warnings}{why}'
        rospy.loginfo(self._state)
        return UpdateModelResponse(True, self._state, time.monotonic() - began)

    def _not_updated(self, name, why, began):
        """The answer to a request that was refused; the last update stays."""
        self._refused = True
        self._state = f'{name} not updated: {why}; ~locate answers from {self._located_from()}'
        rospy.logwarn(self._state)
        return UpdateModelResponse(False, self._state, time.monotonic() - began)

    def _located_from(self):
        """The update that ~locate answers from, for people."""
        updated = self._updated
        return 'none' if updated is None else f'{updated.summary["from_key"]} -> {updated.summary["to_key"]}'

    def _overlay(self, updated, field):
        """The picture, as a message and as an array, and ''; or None twice, and why there is none."""
        try:
            stage = read_stage(self._values['case'], field.to_key)
            picture = overlay_of(updated, field, stage)
        except CortshiftError as error:
            return None, None, f'; no overlay: {error}'
        height, width, _ = picture.shape
        image = Image(height=height, width=width, encoding='bgr8', step=3 * width, data=picture.tobytes())
        image.header.stamp, image.header.frame_id = rospy.Time.from_sec(stage.stamp), stage.left_info.header.frame_id
        return image, picture, ''

    def _stages(self, request):
        """Key to StageInfo of the request's stages, those that there are. Raises ModelError where shift_tracker does not say them."""
        try:
            rospy.wait_for_service('shift_tracker/list_stages', timeout=2.0)
            stages = rospy.ServiceProxy('shift_tracker/list_stages', ListStages)().stages
        except (rospy.ROSException, rospy.ServiceException) as error:
            raise ModelError(f'shift_tracker does not answer ({error}), so the stages of the field cannot be checked; start it') from error
        return {stage.key: stage for stage in stages if stage.key in (request.from_key, request.to_key)}

    def _resected(self):
        """Volume of what was taken out until now, or None."""
        path = rospy.get_param('~resected', '')   # may be set when the tissue is out
        return load_marked(replace(self._source, path=str(path))) if path else None

    def _gravity(self):
        measured = gravity_of(read_points(self._values['case']))
        given = np.array(self._values['gravity'])
        if measured is not None or not given.any():
            return measured
        return direction_of(given, 'parameter gravity')

    def _locate(self, request):
        points = np.array([[p.x, p.y, p.z] for p in request.pmr]).reshape(-1, 3)
        updated = self._updated
        if updated is None or not len(points):
            nothing = float('nan')
            return LocateResponse([Point(nothing, nothing, nothing)] * len(points), [nothing] * len(points), [0] * len(points))
        now, sd, known = located(self._model, updated.update, np.where(np.isfinite(points), points, 1e3), updated.resected)
        return LocateResponse([Point(*place) for place in now], sd.tolist(), known.astype(np.uint8).tolist())

    def _report(self):
        while not rospy.is_shutdown():
            level = DiagnosticStatus.WARN if self._updated is None or self._refused else DiagnosticStatus.OK
            status = DiagnosticStatus(level=level, name='brain_model: state', hardware_id='brain_model', message=self._state,
                                      values=[KeyValue('model', self._values['model']), KeyValue('locate answers from', self._located_from())])
            array = DiagnosticArray(status=[status])
            array.header.stamp = rospy.Time.now()
            self._diagnostics.publish(array)
            time.sleep(1.0)


def main():
    rospy.init_node('brain_model')
    try:
        node = BrainModelNode()
    except (ParameterError, CortshiftError, OSError) as error:
        rospy.logfatal('brain_model does not start: %s', error)
        return 1
    rospy.spin()
    del node
    return 0
