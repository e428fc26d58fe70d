; A function that Python calls with a state and parameters, by the protocol METH_FASTCALL: it copies both to the memory
; of a run, calls the loop without the interpreter's lock, and returns a copy of the final state; None where Python has
; to look: arrays of other types or sizes, memory in use by another thread, a run that paused or did not succeed.
; The memory is that of `dalembert.codegen.llvm.direct_call`: the loop, its arguments, the start and its bytes, the
; parameters and their bytes, the copying method, None, and whether a run is under way.
%buffer = type {ptr, ptr, i64, i64, i32, i32, ptr, ptr, ptr, ptr, ptr}
declare ptr @PyCapsule_GetPointer(ptr, ptr)
declare i32 @PyObject_GetBuffer(ptr, ptr, i32)
declare void @PyBuffer_Release(ptr)
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
declare ptr @PyObject_CallNoArgs(ptr)
declare void @PyErr_Clear()
declare void @Py_IncRef(ptr)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)

; Copies the numbers of an object; whether it has so many bytes of them, one after the other.
define internal i1 @copied(ptr %object, ptr %to, i64 %bytes) nounwind {
entry:
  %view = alloca %buffer
  %failed = call i32 @PyObject_GetBuffer(ptr %object, ptr %view, i32 60)
  %has = icmp eq i32 %failed, 0
  br i1 %has, label %look, label %none
none:
  call void @PyErr_Clear()
  ret i1 false
look:
  %length.at = getelementptr %buffer, ptr %view, i64 0, i32 2
  %length = load i64, ptr %length.at
  %dimensions.at = getelementptr %buffer, ptr %view, i64 0, i32 5
  %dimensions = load i32, ptr %dimensions.at
  %format.at = getelementptr %buffer, ptr %view, i64 0, i32 6
  %format = load ptr, ptr %format.at
  %letters = load i16, ptr %format, align 1
  %fits.length = icmp eq i64 %length, %bytes
  %fits.dimensions = icmp eq i32 %dimensions, 1
  %fits.format = icmp eq i16 %letters, 100
  %fits.shape = and i1 %fits.length, %fits.dimensions
  %fits = and i1 %fits.shape, %fits.format
  br i1 %fits, label %copy, label %done
copy:
  %from = load ptr, ptr %view
  call void @llvm.memcpy.p0.p0.i64(ptr %to, ptr %from, i64 %bytes, i1 false)
  br label %done
done:
  call void @PyBuffer_Release(ptr %view)
  ret i1 %fits
}

define ptr @direct_call(ptr %self, ptr %objects, i64 %count) nounwind {
entry:
  %memory = call ptr @PyCapsule_GetPointer(ptr %self, ptr null)
  %none.at = getelementptr ptr, ptr %memory, i64 7
  %none = load ptr, ptr %none.at
  %busy.at = getelementptr i64, ptr %memory, i64 8
  %busy = load i64, ptr %busy.at
  %free = icmp eq i64 %busy, 0
  %two = icmp eq i64 %count, 2
  %may = and i1 %free, %two
  br i1 %may, label %take, label %other
take:
  %start.at = getelementptr ptr, ptr %memory, i64 2
  %start = load ptr, ptr %start.at
  %start.bytes.at = getelementptr i64, ptr %memory, i64 3
  %start.bytes = load i64, ptr %start.bytes.at
  %state = load ptr, ptr %objects
  %has.state = call i1 @copied(ptr %state, ptr %start, i64 %start.bytes)
  br i1 %has.state, label %parameters, label %other
parameters:
  %given.at = getelementptr ptr, ptr %memory, i64 4
  %given = load ptr, ptr %given.at
  %given.bytes.at = getelementptr i64, ptr %memory, i64 5
  %given.bytes = load i64, ptr %given.bytes.at
  %second.at = getelementptr ptr, ptr %objects, i64 1
  %second = load ptr, ptr %second.at
  %has.parameters = call i1 @copied(ptr %second, ptr %given, i64 %given.bytes)
  br i1 %has.parameters, label %run, label %other
run:
  %loop = load ptr, ptr %memory
  %arguments.at = getelementptr ptr, ptr %memory, i64 1
  %arguments = load ptr, ptr %arguments.at
  store i64 1, ptr %busy.at
  %thread = call ptr @PyEval_SaveThread()
  %status = call i64 %loop(ptr %arguments)
  call void @PyEval_RestoreThread(ptr %thread)
  store i64 0, ptr %busy.at
  %good = icmp eq i64 %status, 0
  br i1 %good, label %return, label %other
return:
  %copy.at = getelementptr ptr, ptr %memory, i64 6
  %copy = load ptr, ptr %copy.at
  %final = call ptr @PyObject_CallNoArgs(ptr %copy)
  ret ptr %final
other:
  call void @Py_IncRef(ptr %none)
  ret ptr %none
}
