declare double @sin(double)
declare double @cos(double)
declare double @tan(double)
declare double @asin(double)
declare double @acos(double)
declare double @atan(double)
declare double @exp(double)
declare double @log(double)
declare double @sinh(double)
declare double @cosh(double)
declare double @tanh(double)
declare double @atan2(double, double)
declare double @pow(double, double)
declare double @llvm.fabs.f64(double)
declare double @llvm.sqrt.f64(double)
declare double @llvm.floor.f64(double)
declare double @llvm.fma.f64(double, double, double)
declare <2 x double> @llvm.fabs.v2f64(<2 x double>)
declare <2 x double> @llvm.sqrt.v2f64(<2 x double>)
declare <2 x double> @llvm.floor.v2f64(<2 x double>)
declare <2 x double> @llvm.fma.v2f64(<2 x double>, <2 x double>, <2 x double>)
declare <4 x double> @llvm.fabs.v4f64(<4 x double>)
declare <4 x double> @llvm.sqrt.v4f64(<4 x double>)
declare <4 x double> @llvm.floor.v4f64(<4 x double>)
declare <4 x double> @llvm.fma.v4f64(<4 x double>, <4 x double>, <4 x double>)
declare <8 x double> @llvm.fabs.v8f64(<8 x double>)
declare <8 x double> @llvm.sqrt.v8f64(<8 x double>)
declare <8 x double> @llvm.floor.v8f64(<8 x double>)
declare <8 x double> @llvm.fma.v8f64(<8 x double>, <8 x double>, <8 x double>)

define internal {<2 x double>, <2 x double>} @sincos2(<2 x double> %x) alwaysinline nounwind {
entry:
  %size = call <2 x double> @llvm.fabs.v2f64(<2 x double> %x)
  %large = fcmp ugt <2 x double> %size, <double 0x412E848000000000, double 0x412E848000000000>
  %bits = bitcast <2 x i1> %large to i2
  %any = icmp ne i2 %bits, 0
  %shifted = call <2 x double> @llvm.fma.v2f64(<2 x double> %x, <2 x double> <double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883>, <2 x double> <double 0x4338000000000000, double 0x4338000000000000>)
  %k = fsub <2 x double> %shifted, <double 0x4338000000000000, double 0x4338000000000000>
  %q = bitcast <2 x double> %shifted to <2 x i64>
  %minus = fneg <2 x double> %k
  %r1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %minus, <2 x double> <double 0x3FF921FB54400000, double 0x3FF921FB54400000>, <2 x double> %x)
  %r2 = call <2 x double> @llvm.fma.v2f64(<2 x double> %minus, <2 x double> <double 0x3DD0B4611A600000, double 0x3DD0B4611A600000>, <2 x double> %r1)
  %r = call <2 x double> @llvm.fma.v2f64(<2 x double> %minus, <2 x double> <double 0x3BA3198A2E037073, double 0x3BA3198A2E037073>, <2 x double> %r2)
  %z = fmul <2 x double> %r, %r
  %sp.4 = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C>, <2 x double> %z, <2 x double> <double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB>)
  %sp.3 = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.4, <2 x double> %z, <2 x double> <double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D>)
  %sp.2 = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.3, <2 x double> %z, <2 x double> <double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5>)
  %sp.1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.2, <2 x double> %z, <2 x double> <double 0x3F8111111110F8A6, double 0x3F8111111110F8A6>)
  %sp = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.1, <2 x double> %z, <2 x double> <double 0xBFC5555555555549, double 0xBFC5555555555549>)
  %cp.4 = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4>, <2 x double> %z, <2 x double> <double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4>)
  %cp.3 = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.4, <2 x double> %z, <2 x double> <double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD>)
  %cp.2 = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.3, <2 x double> %z, <2 x double> <double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590>)
  %cp.1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.2, <2 x double> %z, <2 x double> <double 0xBF56C16C16C15177, double 0xBF56C16C16C15177>)
  %cp = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.1, <2 x double> %z, <2 x double> <double 0x3FA555555555554C, double 0x3FA555555555554C>)
  %rz = fmul <2 x double> %r, %z
  %sine = call <2 x double> @llvm.fma.v2f64(<2 x double> %rz, <2 x double> %sp, <2 x double> %r)
  %hz = fmul <2 x double> %z, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %one = fsub <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %hz
  %lost = fsub <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %one
  %rest = fsub <2 x double> %lost, %hz
  %zz = fmul <2 x double> %z, %z
  %tail = call <2 x double> @llvm.fma.v2f64(<2 x double> %zz, <2 x double> %cp, <2 x double> %rest)
  %cosine = fadd <2 x double> %one, %tail
  %low = and <2 x i64> %q, <i64 1, i64 1>
  %odd = icmp ne <2 x i64> %low, <i64 0, i64 0>
  %s.a = select <2 x i1> %odd, <2 x double> %cosine, <2 x double> %sine
  %c.a = select <2 x i1> %odd, <2 x double> %sine, <2 x double> %cosine
  %s.bit = and <2 x i64> %q, <i64 2, i64 2>
  %s.sign = shl <2 x i64> %s.bit, <i64 62, i64 62>
  %q1 = add <2 x i64> %q, <i64 1, i64 1>
  %c.bit = and <2 x i64> %q1, <i64 2, i64 2>
  %c.sign = shl <2 x i64> %c.bit, <i64 62, i64 62>
  %s.i = bitcast <2 x double> %s.a to <2 x i64>
  %c.i = bitcast <2 x double> %c.a to <2 x i64>
  %s.x = xor <2 x i64> %s.i, %s.sign
  %c.x = xor <2 x i64> %c.i, %c.sign
  %s.f = bitcast <2 x i64> %s.x to <2 x double>
  %c.f = bitcast <2 x i64> %c.x to <2 x double>
  br i1 %any, label %slow, label %done
slow:
  %slow.s.0.0 = extractelement <2 x double> %x, i32 0
  %slow.s.0 = call double @sin(double %slow.s.0.0)
  %slow.s.pack0 = insertelement <2 x double> undef, double %slow.s.0, i32 0
  %slow.s.1.0 = extractelement <2 x double> %x, i32 1
  %slow.s.1 = call double @sin(double %slow.s.1.0)
  %slow.s = insertelement <2 x double> %slow.s.pack0, double %slow.s.1, i32 1
  %slow.c.0.0 = extractelement <2 x double> %x, i32 0
  %slow.c.0 = call double @cos(double %slow.c.0.0)
  %slow.c.pack0 = insertelement <2 x double> undef, double %slow.c.0, i32 0
  %slow.c.1.0 = extractelement <2 x double> %x, i32 1
  %slow.c.1 = call double @cos(double %slow.c.1.0)
  %slow.c = insertelement <2 x double> %slow.c.pack0, double %slow.c.1, i32 1
  ; the neighbours of a large argument keep what they would have alone
  %s.l = select <2 x i1> %large, <2 x double> %slow.s, <2 x double> %s.f
  %c.l = select <2 x i1> %large, <2 x double> %slow.c, <2 x double> %c.f
  br label %done
done:
  %s = phi <2 x double> [%s.f, %entry], [%s.l, %slow]
  %c = phi <2 x double> [%c.f, %entry], [%c.l, %slow]
  %pair = insertvalue {<2 x double>, <2 x double>} undef, <2 x double> %s, 0
  %both = insertvalue {<2 x double>, <2 x double>} %pair, <2 x double> %c, 1
  ret {<2 x double>, <2 x double>} %both
}

define internal {<4 x double>, <4 x double>} @sincos4(<4 x double> %x) alwaysinline nounwind {
entry:
  %size = call <4 x double> @llvm.fabs.v4f64(<4 x double> %x)
  %large = fcmp ugt <4 x double> %size, <double 0x412E848000000000, double 0x412E848000000000, double 0x412E848000000000, double 0x412E848000000000>
  %bits = bitcast <4 x i1> %large to i4
  %any = icmp ne i4 %bits, 0
  %shifted = call <4 x double> @llvm.fma.v4f64(<4 x double> %x, <4 x double> <double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883>, <4 x double> <double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000>)
  %k = fsub <4 x double> %shifted, <double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000>
  %q = bitcast <4 x double> %shifted to <4 x i64>
  %minus = fneg <4 x double> %k
  %r1 = call <4 x double> @llvm.fma.v4f64(<4 x double> %minus, <4 x double> <double 0x3FF921FB54400000, double 0x3FF921FB54400000, double 0x3FF921FB54400000, double 0x3FF921FB54400000>, <4 x double> %x)
  %r2 = call <4 x double> @llvm.fma.v4f64(<4 x double> %minus, <4 x double> <double 0x3DD0B4611A600000, double 0x3DD0B4611A600000, double 0x3DD0B4611A600000, double 0x3DD0B4611A600000>, <4 x double> %r1)
  %r = call <4 x double> @llvm.fma.v4f64(<4 x double> %minus, <4 x double> <double 0x3BA3198A2E037073, double 0x3BA3198A2E037073, double 0x3BA3198A2E037073, double 0x3BA3198A2E037073>, <4 x double> %r2)
  %z = fmul <4 x double> %r, %r
  %sp.4 = call <4 x double> @llvm.fma.v4f64(<4 x double> <double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C>, <4 x double> %z, <4 x double> <double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB>)
  %sp.3 = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.4, <4 x double> %z, <4 x double> <double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D>)
  %sp.2 = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.3, <4 x double> %z, <4 x double> <double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5>)
  %sp.1 = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.2, <4 x double> %z, <4 x double> <double 0x3F8111111110F8A6, double 0x3F8111111110F8A6, double 0x3F8111111110F8A6, double 0x3F8111111110F8A6>)
  %sp = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.1, <4 x double> %z, <4 x double> <double 0xBFC5555555555549, double 0xBFC5555555555549, double 0xBFC5555555555549, double 0xBFC5555555555549>)
  %cp.4 = call <4 x double> @llvm.fma.v4f64(<4 x double> <double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4>, <4 x double> %z, <4 x double> <double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4>)
  %cp.3 = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.4, <4 x double> %z, <4 x double> <double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD>)
  %cp.2 = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.3, <4 x double> %z, <4 x double> <double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590>)
  %cp.1 = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.2, <4 x double> %z, <4 x double> <double 0xBF56C16C16C15177, double 0xBF56C16C16C15177, double 0xBF56C16C16C15177, double 0xBF56C16C16C15177>)
  %cp = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.1, <4 x double> %z, <4 x double> <double 0x3FA555555555554C, double 0x3FA555555555554C, double 0x3FA555555555554C, double 0x3FA555555555554C>)
  %rz = fmul <4 x double> %r, %z
  %sine = call <4 x double> @llvm.fma.v4f64(<4 x double> %rz, <4 x double> %sp, <4 x double> %r)
  %hz = fmul <4 x double> %z, <double 0x3FE0000000000000, double 0x3FE0000000000000, double 0x3FE0000000000000, double 0x3FE0000000000000>
  %one = fsub <4 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000>, %hz
  %lost = fsub <4 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000>, %one
  %rest = fsub <4 x double> %lost, %hz
  %zz = fmul <4 x double> %z, %z
  %tail = call <4 x double> @llvm.fma.v4f64(<4 x double> %zz, <4 x double> %cp, <4 x double> %rest)
  %cosine = fadd <4 x double> %one, %tail
  %low = and <4 x i64> %q, <i64 1, i64 1, i64 1, i64 1>
  %odd = icmp ne <4 x i64> %low, <i64 0, i64 0, i64 0, i64 0>
  %s.a = select <4 x i1> %odd, <4 x double> %cosine, <4 x double> %sine
  %c.a = select <4 x i1> %odd, <4 x double> %sine, <4 x double> %cosine
  %s.bit = and <4 x i64> %q, <i64 2, i64 2, i64 2, i64 2>
  %s.sign = shl <4 x i64> %s.bit, <i64 62, i64 62, i64 62, i64 62>
  %q1 = add <4 x i64> %q, <i64 1, i64 1, i64 1, i64 1>
  %c.bit = and <4 x i64> %q1, <i64 2, i64 2, i64 2, i64 2>
  %c.sign = shl <4 x i64> %c.bit, <i64 62, i64 62, i64 62, i64 62>
  %s.i = bitcast <4 x double> %s.a to <4 x i64>
  %c.i = bitcast <4 x double> %c.a to <4 x i64>
  %s.x = xor <4 x i64> %s.i, %s.sign
  %c.x = xor <4 x i64> %c.i, %c.sign
  %s.f = bitcast <4 x i64> %s.x to <4 x double>
  %c.f = bitcast <4 x i64> %c.x to <4 x double>
  br i1 %any, label %slow, label %done
slow:
  %slow.s.0.0 = extractelement <4 x double> %x, i32 0
  %slow.s.0 = call double @sin(double %slow.s.0.0)
  %slow.s.pack0 = insertelement <4 x double> undef, double %slow.s.0, i32 0
  %slow.s.1.0 = extractelement <4 x double> %x, i32 1
  %slow.s.1 = call double @sin(double %slow.s.1.0)
  %slow.s.pack1 = insertelement <4 x double> %slow.s.pack0, double %slow.s.1, i32 1
  %slow.s.2.0 = extractelement <4 x double> %x, i32 2
  %slow.s.2 = call double @sin(double %slow.s.2.0)
  %slow.s.pack2 = insertelement <4 x double> %slow.s.pack1, double %slow.s.2, i32 2
  %slow.s.3.0 = extractelement <4 x double> %x, i32 3
  %slow.s.3 = call double @sin(double %slow.s.3.0)
  %slow.s = insertelement <4 x double> %slow.s.pack2, double %slow.s.3, i32 3
  %slow.c.0.0 = extractelement <4 x double> %x, i32 0
  %slow.c.0 = call double @cos(double %slow.c.0.0)
  %slow.c.pack0 = insertelement <4 x double> undef, double %slow.c.0, i32 0
  %slow.c.1.0 = extractelement <4 x double> %x, i32 1
  %slow.c.1 = call double @cos(double %slow.c.1.0)
  %slow.c.pack1 = insertelement <4 x double> %slow.c.pack0, double %slow.c.1, i32 1
  %slow.c.2.0 = extractelement <4 x double> %x, i32 2
  %slow.c.2 = call double @cos(double %slow.c.2.0)
  %slow.c.pack2 = insertelement <4 x double> %slow.c.pack1, double %slow.c.2, i32 2
  %slow.c.3.0 = extractelement <4 x double> %x, i32 3
  %slow.c.3 = call double @cos(double %slow.c.3.0)
  %slow.c = insertelement <4 x double> %slow.c.pack2, double %slow.c.3, i32 3
  ; the neighbours of a large argument keep what they would have alone
  %s.l = select <4 x i1> %large, <4 x double> %slow.s, <4 x double> %s.f
  %c.l = select <4 x i1> %large, <4 x double> %slow.c, <4 x double> %c.f
  br label %done
done:
  %s = phi <4 x double> [%s.f, %entry], [%s.l, %slow]
  %c = phi <4 x double> [%c.f, %entry], [%c.l, %slow]
  %pair = insertvalue {<4 x double>, <4 x double>} undef, <4 x double> %s, 0
  %both = insertvalue {<4 x double>, <4 x double>} %pair, <4 x double> %c, 1
  ret {<4 x double>, <4 x double>} %both
}

; Good to 0.005 for positive normal numbers: the bits of a number, read as an integer, are its logarithm with straight
; lines between the powers of two; a parabola takes off most of what that is wrong by.
define internal double @rough_log2(double %x) alwaysinline nounwind {
  %i = bitcast double %x to i64
  %high = lshr i64 %i, 12
  %magic = or i64 %high, 4841369599423283200
  %float = bitcast i64 %magic to double
  %m.raw = and i64 %i, 4503599627370495
  %m.one = or i64 %m.raw, 4607182418800017408
  %m = bitcast i64 %m.one to double
  %line = call double @llvm.fma.f64(double %float, double 0x3D70000000000000, double 0xC0B3FFACC4C79AB4)
  %slope = call double @llvm.fma.f64(double 0xBFD611FE8FE86AE3, double %m, double 0x3FF06507B987CB91)
  %log = call double @llvm.fma.f64(double %slope, double %m, double %line)
  ret double %log
}

; Good to 1e-4 relative; the argument is limited to +-1000.
define internal double @rough_exp2(double %x) alwaysinline nounwind {
  %above = fcmp ogt double %x, 0xC08F400000000000
  %x.low = select i1 %above, double %x, double 0xC08F400000000000
  %below = fcmp olt double %x.low, 0x408F400000000000
  %x.held = select i1 %below, double %x.low, double 0x408F400000000000
  %shifted = fadd double %x.held, 0x4338000000000000
  %whole = fsub double %shifted, 0x4338000000000000
  %r = fsub double %x.held, %whole
  %i = bitcast double %shifted to i64
  %exponent = shl i64 %i, 52
  %p.2 = call double @llvm.fma.f64(double 0x3FAC3F760CA1A3FF, double %r, double 0x3FCF0DE1BFF8FEDA)
  %p.1 = call double @llvm.fma.f64(double %p.2, double %r, double 0x3FE62F31ABF4900A)
  %p = call double @llvm.fma.f64(double %p.1, double %r, double 0x3FEFFF6926E013A6)
  %p.bits = bitcast double %p to i64
  %bits = add i64 %p.bits, %exponent
  %power = bitcast i64 %bits to double
  ret double %power
}

declare ptr @malloc(i64)
declare void @free(ptr)

; The sum of a[j] b[-j] for j = 0 .. count - 1: four sums at a time, which need not wait for each other, then the rest.
define internal double @convolve(ptr %a, ptr %b, i64 %count) nounwind noinline {
entry:
  %fours = and i64 %count, -4
  %few = icmp eq i64 %fours, 0
  br i1 %few, label %rest, label %four
four:
  %i = phi i64 [0, %entry], [%i.next, %four]
  %sum.0 = phi double [0x0000000000000000, %entry], [%more.0, %four]
  %sum.1 = phi double [0x0000000000000000, %entry], [%more.1, %four]
  %sum.2 = phi double [0x0000000000000000, %entry], [%more.2, %four]
  %sum.3 = phi double [0x0000000000000000, %entry], [%more.3, %four]
  %j.0 = add i64 %i, 0
  %back.0 = sub i64 0, %j.0
  %a.at.0 = getelementptr double, ptr %a, i64 %j.0
  %b.at.0 = getelementptr double, ptr %b, i64 %back.0
  %x.0 = load double, ptr %a.at.0, align 8
  %z.0 = load double, ptr %b.at.0, align 8
  %more.0 = call double @llvm.fma.f64(double %x.0, double %z.0, double %sum.0)
  %j.1 = add i64 %i, 1
  %back.1 = sub i64 0, %j.1
  %a.at.1 = getelementptr double, ptr %a, i64 %j.1
  %b.at.1 = getelementptr double, ptr %b, i64 %back.1
  %x.1 = load double, ptr %a.at.1, align 8
  %z.1 = load double, ptr %b.at.1, align 8
  %more.1 = call double @llvm.fma.f64(double %x.1, double %z.1, double %sum.1)
  %j.2 = add i64 %i, 2
  %back.2 = sub i64 0, %j.2
  %a.at.2 = getelementptr double, ptr %a, i64 %j.2
  %b.at.2 = getelementptr double, ptr %b, i64 %back.2
  %x.2 = load double, ptr %a.at.2, align 8
  %z.2 = load double, ptr %b.at.2, align 8
  %more.2 = call double @llvm.fma.f64(double %x.2, double %z.2, double %sum.2)
  %j.3 = add i64 %i, 3
  %back.3 = sub i64 0, %j.3
  %a.at.3 = getelementptr double, ptr %a, i64 %j.3
  %b.at.3 = getelementptr double, ptr %b, i64 %back.3
  %x.3 = load double, ptr %a.at.3, align 8
  %z.3 = load double, ptr %b.at.3, align 8
  %more.3 = call double @llvm.fma.f64(double %x.3, double %z.3, double %sum.3)
  %i.next = add i64 %i, 4
  %full = icmp eq i64 %i.next, %fours
  br i1 %full, label %joined, label %four
joined:
  %low = fadd double %more.0, %more.1
  %high = fadd double %more.2, %more.3
  %both = fadd double %low, %high
  br label %rest
rest:
  %known = phi double [0x0000000000000000, %entry], [%both, %joined]
  %none = icmp eq i64 %fours, %count
  br i1 %none, label %done, label %loop
loop:
  %j = phi i64 [%fours, %rest], [%next, %loop]
  %sum = phi double [%known, %rest], [%more, %loop]
  %back = sub i64 0, %j
  %a.at = getelementptr double, ptr %a, i64 %j
  %b.at = getelementptr double, ptr %b, i64 %back
  %x = load double, ptr %a.at, align 8
  %z = load double, ptr %b.at, align 8
  %more = call double @llvm.fma.f64(double %x, double %z, double %sum)
  %next = add i64 %j, 1
  %last = icmp eq i64 %next, %count
  br i1 %last, label %done, label %loop
done:
  %result = phi double [%known, %rest], [%more, %loop]
  ret double %result
}

; Coefficients 0 of some values.
define internal void @first.0(ptr %n.work) nounwind noinline {
entry:
  %x.2 = add i64 0, 0
  %x.3 = getelementptr double, ptr %n.work, i64 %x.2
  %x.1 = load double, ptr %x.3, align 8
  %sine.pair.0 = insertelement <2 x double> undef, double %x.1, i32 0
  %sine.pair.1 = insertelement <2 x double> %sine.pair.0, double %x.1, i32 1
  %sine.pair = call {<2 x double>, <2 x double>} @sincos2(<2 x double> %sine.pair.1)
  %sine.pack = extractvalue {<2 x double>, <2 x double>} %sine.pair, 0
  %sine = extractelement <2 x double> %sine.pack, i32 0
  %x.4 = add i64 0, 8
  %x.5 = getelementptr double, ptr %n.work, i64 %x.4
  store double %sine, ptr %x.5, align 8
  %sine_partner.pack = extractvalue {<2 x double>, <2 x double>} %sine.pair, 1
  %sine_partner = extractelement <2 x double> %sine_partner.pack, i32 0
  %x.6 = add i64 0, 12
  %x.7 = getelementptr double, ptr %n.work, i64 %x.6
  store double %sine_partner, ptr %x.7, align 8
  %x.8 = getelementptr double, ptr %n.work, i64 36
  %x.9 = load double, ptr %x.8, align 8
  %weight = fmul double %x.9, %sine
  %x.10 = add i64 0, 16
  %x.11 = getelementptr double, ptr %n.work, i64 %x.10
  store double %weight, ptr %x.11, align 8
  %x.13 = add i64 0, 4
  %x.14 = getelementptr double, ptr %n.work, i64 %x.13
  %x.12 = load double, ptr %x.14, align 8
  %speed = fmul double %x.12, %x.12
  %x.15 = add i64 0, 20
  %x.16 = getelementptr double, ptr %n.work, i64 %x.15
  store double %speed, ptr %x.16, align 8
  %x.17 = getelementptr double, ptr %n.work, i64 37
  %x.18 = load double, ptr %x.17, align 8
  %resistance = fmul double %x.18, %speed
  %x.19 = add i64 0, 24
  %x.20 = getelementptr double, ptr %n.work, i64 %x.19
  store double %resistance, ptr %x.20, align 8
  %pull = fadd double %weight, %resistance
  %x.21 = add i64 0, 28
  %x.22 = getelementptr double, ptr %n.work, i64 %x.21
  store double %pull, ptr %x.22, align 8
  %rate = fneg double %pull
  %x.23 = add i64 0, 32
  %x.24 = getelementptr double, ptr %n.work, i64 %x.23
  store double %rate, ptr %x.24, align 8
  ret void
}

; Coefficients k of some values.
define internal void @next.0(ptr %n.work, i64 %n.k) nounwind noinline {
entry:
  %n.next = add i64 %n.k, 1
  %n.order.one = uitofp i64 %n.k to double
  %n.order = bitcast double %n.order.one to double
  %x.25 = add i64 0, 4
  %x.26 = getelementptr double, ptr %n.work, i64 %x.25
  %x.27 = add i64 %n.k, 11
  %x.28 = getelementptr double, ptr %n.work, i64 %x.27
  %x.29 = call double @convolve(ptr %x.26, ptr %x.28, i64 %n.k)
  %x.30 = fadd double 0x0000000000000000, %x.29
  %x.31 = fdiv double %x.30, %n.order
  %x.32 = add i64 %n.k, 8
  %x.33 = getelementptr double, ptr %n.work, i64 %x.32
  store double %x.31, ptr %x.33, align 8
  %x.34 = add i64 0, 4
  %x.35 = getelementptr double, ptr %n.work, i64 %x.34
  %x.36 = add i64 %n.k, 7
  %x.37 = getelementptr double, ptr %n.work, i64 %x.36
  %x.38 = call double @convolve(ptr %x.35, ptr %x.37, i64 %n.k)
  %x.39 = fsub double 0x0000000000000000, %x.38
  %x.40 = fdiv double %x.39, %n.order
  %x.41 = add i64 %n.k, 12
  %x.42 = getelementptr double, ptr %n.work, i64 %x.41
  store double %x.40, ptr %x.42, align 8
  %x.44 = getelementptr double, ptr %n.work, i64 36
  %x.45 = load double, ptr %x.44, align 8
  %x.47 = add i64 %n.k, 8
  %x.48 = getelementptr double, ptr %n.work, i64 %x.47
  %x.46 = load double, ptr %x.48, align 8
  %x.43 = fmul double %x.45, %x.46
  %x.49 = add i64 %n.k, 16
  %x.50 = getelementptr double, ptr %n.work, i64 %x.49
  store double %x.43, ptr %x.50, align 8
  %x.51 = add i64 0, 4
  %x.52 = getelementptr double, ptr %n.work, i64 %x.51
  %x.53 = add i64 %n.k, 4
  %x.54 = getelementptr double, ptr %n.work, i64 %x.53
  %x.55 = call double @convolve(ptr %x.52, ptr %x.54, i64 %n.next)
  %x.56 = add i64 %n.k, 20
  %x.57 = getelementptr double, ptr %n.work, i64 %x.56
  store double %x.55, ptr %x.57, align 8
  %x.59 = getelementptr double, ptr %n.work, i64 37
  %x.60 = load double, ptr %x.59, align 8
  %x.62 = add i64 %n.k, 20
  %x.63 = getelementptr double, ptr %n.work, i64 %x.62
  %x.61 = load double, ptr %x.63, align 8
  %x.58 = fmul double %x.60, %x.61
  %x.64 = add i64 %n.k, 24
  %x.65 = getelementptr double, ptr %n.work, i64 %x.64
  store double %x.58, ptr %x.65, align 8
  %x.68 = add i64 %n.k, 16
  %x.69 = getelementptr double, ptr %n.work, i64 %x.68
  %x.67 = load double, ptr %x.69, align 8
  %x.71 = add i64 %n.k, 24
  %x.72 = getelementptr double, ptr %n.work, i64 %x.71
  %x.70 = load double, ptr %x.72, align 8
  %x.66 = fadd double %x.67, %x.70
  %x.73 = add i64 %n.k, 28
  %x.74 = getelementptr double, ptr %n.work, i64 %x.73
  store double %x.66, ptr %x.74, align 8
  %x.77 = add i64 %n.k, 28
  %x.78 = getelementptr double, ptr %n.work, i64 %x.77
  %x.76 = load double, ptr %x.78, align 8
  %x.75 = fneg double %x.76
  %x.79 = add i64 %n.k, 32
  %x.80 = getelementptr double, ptr %n.work, i64 %x.79
  store double %x.75, ptr %x.80, align 8
  ret void
}

; A Taylor step: the series of every value lies in memory, and each pass of the loop computes the next order.
define void @step(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %s, ptr noalias nocapture %out) nounwind noinline {
entry:
  %n.work = alloca [304 x i8], align 64
  %x.at = getelementptr double, ptr %y, i64 0
  %x = load double, ptr %x.at, align 8
  %x.81 = add i64 0, 0
  %x.82 = getelementptr double, ptr %n.work, i64 %x.81
  store double %x, ptr %x.82, align 8
  %x_dot.at = getelementptr double, ptr %y, i64 1
  %x_dot = load double, ptr %x_dot.at, align 8
  %x.83 = add i64 0, 4
  %x.84 = getelementptr double, ptr %n.work, i64 %x.83
  store double %x_dot, ptr %x.84, align 8
  %square.at = getelementptr double, ptr %c, i64 0
  %square = load double, ptr %square.at, align 8
  %x.85 = getelementptr double, ptr %n.work, i64 36
  store double %square, ptr %x.85, align 8
  %drag.at = getelementptr double, ptr %c, i64 1
  %drag = load double, ptr %drag.at, align 8
  %x.86 = getelementptr double, ptr %n.work, i64 37
  store double %drag, ptr %x.86, align 8
  call void @first.0(ptr %n.work)
  %x.88 = add i64 0, 4
  %x.89 = getelementptr double, ptr %n.work, i64 %x.88
  %x.87 = load double, ptr %x.89, align 8
  %x.90 = add i64 1, 0
  %x.91 = getelementptr double, ptr %n.work, i64 %x.90
  store double %x.87, ptr %x.91, align 8
  %x.93 = add i64 0, 32
  %x.94 = getelementptr double, ptr %n.work, i64 %x.93
  %x.92 = load double, ptr %x.94, align 8
  %x.95 = add i64 1, 4
  %x.96 = getelementptr double, ptr %n.work, i64 %x.95
  store double %x.92, ptr %x.96, align 8
  br label %orders
orders:
  %n.k = phi i64 [1, %entry], [%n.next, %orders]
  %n.next = add i64 %n.k, 1
  %n.up.one = uitofp i64 %n.next to double
  %n.up = bitcast double %n.up.one to double
  call void @next.0(ptr %n.work, i64 %n.k)
  %x.99 = add i64 %n.k, 4
  %x.100 = getelementptr double, ptr %n.work, i64 %x.99
  %x.98 = load double, ptr %x.100, align 8
  %x.97 = fdiv double %x.98, %n.up
  %x.101 = add i64 %n.k, 1
  %x.102 = getelementptr double, ptr %n.work, i64 %x.101
  store double %x.97, ptr %x.102, align 8
  %x.105 = add i64 %n.k, 32
  %x.106 = getelementptr double, ptr %n.work, i64 %x.105
  %x.104 = load double, ptr %x.106, align 8
  %x.103 = fdiv double %x.104, %n.up
  %x.107 = add i64 %n.k, 5
  %x.108 = getelementptr double, ptr %n.work, i64 %x.107
  store double %x.103, ptr %x.108, align 8
  %n.finished = icmp eq i64 %n.next, 3
  br i1 %n.finished, label %close, label %orders
close:
  %x.old.at = getelementptr double, ptr %y, i64 0
  %x.old = load double, ptr %x.old.at, align 8
  %x_dot.old.at = getelementptr double, ptr %y, i64 1
  %x_dot.old = load double, ptr %x_dot.old.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load double, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 1
  %direction_ = load double, ptr %direction_.at, align 8
  %floor_.at = getelementptr double, ptr %s, i64 2
  %floor_ = load double, ptr %floor_.at, align 8
  %x.109 = add i64 0, 4
  %x.110 = getelementptr double, ptr %n.work, i64 %x.109
  %rate.0.0 = load double, ptr %x.110, align 8
  %x.111 = add i64 1, 4
  %x.112 = getelementptr double, ptr %n.work, i64 %x.111
  %rate.0.1 = load double, ptr %x.112, align 8
  %x.113 = add i64 2, 4
  %x.114 = getelementptr double, ptr %n.work, i64 %x.113
  %rate.0.2 = load double, ptr %x.114, align 8
  %x.115 = add i64 0, 32
  %x.116 = getelementptr double, ptr %n.work, i64 %x.115
  %rate.1.0 = load double, ptr %x.116, align 8
  %x.117 = add i64 1, 32
  %x.118 = getelementptr double, ptr %n.work, i64 %x.117
  %rate.1.1 = load double, ptr %x.118, align 8
  %x.119 = add i64 2, 32
  %x.120 = getelementptr double, ptr %n.work, i64 %x.119
  %rate.1.2 = load double, ptr %x.120, align 8
  %v_0_ = call double @llvm.fabs.f64(double %x_dot.old)
  %v_1_.test = fcmp ogt double %floor_, %v_0_
  %v_1_ = select i1 %v_1_.test, double %floor_, double %v_0_
  %v_2_ = call double @llvm.fabs.f64(double %x.old)
  %v_3_.test = fcmp olt double %v_2_, 0x402921FB54442D18
  %v_3_ = select i1 %v_3_.test, double %v_2_, double 0x402921FB54442D18
  %v_4_.test = fcmp ogt double %v_1_, %v_3_
  %v_4_ = select i1 %v_4_.test, double %v_1_, double %v_3_
  %v_5_ = call double @rough_log2(double %v_4_)
  %v_6_ = call double @llvm.fabs.f64(double %rate.0.1)
  %v_7_ = call double @llvm.fabs.f64(double %rate.1.1)
  %v_8_.test = fcmp ogt double 0x01A56E1FC2F8F359, %v_6_
  %v_8_ = select i1 %v_8_.test, double 0x01A56E1FC2F8F359, double %v_6_
  %v_9_.test = fcmp ogt double %v_8_, %v_7_
  %v_9_ = select i1 %v_9_.test, double %v_8_, double %v_7_
  %v_10_ = call double @rough_log2(double %v_9_)
  %v_11_ = fsub double %v_5_, %v_10_
  %v_12_ = fadd double %v_11_, 0x3FF0000000000000
  %v_13_ = fmul double %v_12_, 0x3FE0000000000000
  %v_14_ = call double @llvm.fabs.f64(double %rate.0.2)
  %v_15_ = call double @llvm.fabs.f64(double %rate.1.2)
  %v_16_.test = fcmp ogt double 0x01A56E1FC2F8F359, %v_14_
  %v_16_ = select i1 %v_16_.test, double 0x01A56E1FC2F8F359, double %v_14_
  %v_17_.test = fcmp ogt double %v_16_, %v_15_
  %v_17_ = select i1 %v_17_.test, double %v_16_, double %v_15_
  %v_18_ = call double @rough_log2(double %v_17_)
  %v_19_ = fsub double %v_5_, %v_18_
  %v_20_ = fadd double %v_19_, 0x3FF95C01A39FBD68
  %v_21_ = fmul double %v_20_, 0x3FD5555555555555
  %v_22_.test = fcmp olt double %v_21_, %v_13_
  %v_22_ = select i1 %v_22_.test, double %v_21_, double %v_13_
  %v_23_ = fadd double %v_22_, 0xC006818C02A4061F
  %v_24_ = call double @rough_exp2(double %v_23_)
  %v_25_.test = fcmp olt double %v_24_, %largest_
  %v_25_ = select i1 %v_25_.test, double %v_24_, double %largest_
  %v_26_ = fmul double %v_25_, %direction_
  %v_27_ = fmul double %v_26_, %v_26_
  %v_28_ = fmul double %rate.0.1, 0x3FE0000000000000
  %v_29_ = fmul double %rate.0.2, 0x3FD5555555555555
  %v_30_ = call double @llvm.fma.f64(double %v_26_, double %v_28_, double %rate.0.0)
  %v_31_ = call double @llvm.fma.f64(double %v_27_, double %v_29_, double %v_30_)
  %v_32_ = fmul double %v_31_, %v_26_
  %v_33_ = fadd double %x.old, %v_32_
  %v_34_ = call double @llvm.fma.f64(double %v_33_, double 0x0000000000000000, double 0x0000000000000000)
  %v_35_ = fmul double %rate.1.1, 0x3FE0000000000000
  %v_36_ = fmul double %rate.1.2, 0x3FD5555555555555
  %v_37_ = call double @llvm.fma.f64(double %v_26_, double %v_35_, double %rate.1.0)
  %v_38_ = call double @llvm.fma.f64(double %v_27_, double %v_36_, double %v_37_)
  %v_39_ = fmul double %v_38_, %v_26_
  %v_40_ = fadd double %x_dot.old, %v_39_
  %v_41_ = call double @llvm.fma.f64(double %v_40_, double 0x0000000000000000, double %v_34_)
  %out.0 = getelementptr double, ptr %out, i64 0
  store double %v_33_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 1
  store double %v_40_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 2
  store double %v_25_, ptr %out.2, align 8
  %out.3 = getelementptr double, ptr %out, i64 3
  store double %v_41_, ptr %out.3, align 8
  %x.122 = add i64 0, 0
  %x.123 = getelementptr double, ptr %n.work, i64 %x.122
  %x.121 = load double, ptr %x.123, align 8
  %x.124 = getelementptr double, ptr %out, i64 4
  store double %x.121, ptr %x.124, align 8
  %x.126 = add i64 1, 0
  %x.127 = getelementptr double, ptr %n.work, i64 %x.126
  %x.125 = load double, ptr %x.127, align 8
  %x.128 = getelementptr double, ptr %out, i64 5
  store double %x.125, ptr %x.128, align 8
  %x.130 = add i64 2, 0
  %x.131 = getelementptr double, ptr %n.work, i64 %x.130
  %x.129 = load double, ptr %x.131, align 8
  %x.132 = getelementptr double, ptr %out, i64 6
  store double %x.129, ptr %x.132, align 8
  %x.134 = add i64 3, 0
  %x.135 = getelementptr double, ptr %n.work, i64 %x.134
  %x.133 = load double, ptr %x.135, align 8
  %x.136 = getelementptr double, ptr %out, i64 7
  store double %x.133, ptr %x.136, align 8
  %x.138 = add i64 0, 4
  %x.139 = getelementptr double, ptr %n.work, i64 %x.138
  %x.137 = load double, ptr %x.139, align 8
  %x.140 = getelementptr double, ptr %out, i64 8
  store double %x.137, ptr %x.140, align 8
  %x.142 = add i64 1, 4
  %x.143 = getelementptr double, ptr %n.work, i64 %x.142
  %x.141 = load double, ptr %x.143, align 8
  %x.144 = getelementptr double, ptr %out, i64 9
  store double %x.141, ptr %x.144, align 8
  %x.146 = add i64 2, 4
  %x.147 = getelementptr double, ptr %n.work, i64 %x.146
  %x.145 = load double, ptr %x.147, align 8
  %x.148 = getelementptr double, ptr %out, i64 10
  store double %x.145, ptr %x.148, align 8
  %x.150 = add i64 3, 4
  %x.151 = getelementptr double, ptr %n.work, i64 %x.150
  %x.149 = load double, ptr %x.151, align 8
  %x.152 = getelementptr double, ptr %out, i64 11
  store double %x.149, ptr %x.152, align 8
  ret void
}
